// Before the first paint: the look that was chosen last, or the one the system asks for.
(() => {
  let theme = null;
  try { theme = localStorage.getItem("theme"); } catch { /* no storage: the system's wish counts */ }
  if (!["day", "dusk", "night"].includes(theme)) {
    theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dusk" : "day";
  }
  document.documentElement.dataset.theme = theme;
})();
