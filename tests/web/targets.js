// What can be touched, on the screen and whole: smaller than 24 px (WCAG 2.2, 2.5.8), named otherwise than it reads, covered by something else, or outside.
(() => {
  const poor = [];
  let seen = 0;
  const main = document.querySelector("main").getBoundingClientRect();
  for (const element of document.querySelectorAll("button, a, select, input, summary")) {
    if (!element.checkVisibility() || element.matches(".skip")) continue;
    const box = element.getBoundingClientRect(), inside = element.closest("main");
    if (inside && (box.top < main.top || box.bottom > main.bottom)) continue; // scrolled away
    const name = element.id || element.textContent.trim() || element.getAttribute("aria-label");
    seen += 1;
    // WCAG 2.1, 2.5.3: who says what he reads is understood
    const read = element.textContent.trim(), label = element.getAttribute("aria-label");
    if (label && /^[a-z]{2,}/i.test(read) && element.tagName === "BUTTON" && !label.toLowerCase().includes(read.toLowerCase())) poor.push(`${read}: labelled ${label}`);
    if (box.width < 24 || box.height < 24) poor.push(`${name}: ${box.width.toFixed(0)} x ${box.height.toFixed(0)}`);
    if (box.left < -1 || box.right > innerWidth + 1 || box.top < -1 || box.bottom > innerHeight + 1) poor.push(`${name}: outside`);
    const at = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
    if (!at || !(element.contains(at) || at.contains(element))) poor.push(`${name}: covered by ${at?.id || at?.tagName}`);
  }
  if (document.documentElement.scrollWidth > innerWidth) poor.push("wider than the screen");
  if (document.querySelectorAll("h1").length !== 1) poor.push("not one h1");
  return { seen, poor };
})()
