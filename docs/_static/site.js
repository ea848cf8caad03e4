// What scrolls is reached by the keyboard, and the captions of the contents have a level.
addEventListener("DOMContentLoaded", () => {
  for (const caption of document.querySelectorAll('.caption[role="heading"]')) caption.setAttribute("aria-level", "2");
  for (const box of document.querySelectorAll(".highlight pre, .table-wrapper, p:has(> img[src*='wiring-'])")) if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
});
