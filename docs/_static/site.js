// What scrolls is reached by the keyboard, the captions of the contents have a level, and what is too wide for a narrow
// screen stands row by row.
addEventListener("DOMContentLoaded", () => {
  for (const caption of document.querySelectorAll('.caption[role="heading"]')) caption.setAttribute("aria-level", "2");
  const tables = [...document.querySelectorAll("article table")], narrow = matchMedia("(max-width: 46em)");
  for (const table of tables) {
    const heads = [...table.querySelectorAll("thead th")].map((head) => head.textContent.trim());
    for (const row of table.tBodies[0]?.rows ?? []) [...row.cells].forEach((cell, at) => { cell.dataset.head = heads[at] ?? ""; });
  }
  function fit() {
    for (const table of tables) {
      table.classList.remove("stacks");
      table.classList.toggle("stacks", narrow.matches && table.scrollWidth > table.parentElement.clientWidth);
    }
    for (const box of document.querySelectorAll(".highlight pre, .table-wrapper")) if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
  }
  fit();
  narrow.addEventListener("change", fit);
});
