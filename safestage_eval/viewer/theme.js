// The button [data-theme-switch] goes through: as the system says, light, dark. The choice is
// remembered where the browser allows it.
(() => {
  "use strict";
  const ORDER = ["auto", "light", "dark"];
  const KEY = "safestage-theme";
  const root = document.documentElement;

  function remembered() {
    try {
      return localStorage.getItem(KEY);
    } catch {
      return null;
    }
  }

  function apply(name) {
    if (name === "auto") delete root.dataset.theme;
    else root.dataset.theme = name;
    for (const button of document.querySelectorAll("[data-theme-switch]")) {
      button.textContent = `Theme: ${name}`;
      button.title = `Colours: ${name === "auto" ? "as your system says" : name}. Press to change.`;
    }
  }

  let now = ORDER.includes(remembered()) ? remembered() : "auto";
  apply(now);
  document.addEventListener("DOMContentLoaded", () => apply(now));
  document.addEventListener("click", (event) => {
    if (!event.target.closest("[data-theme-switch]")) return;
    now = ORDER[(ORDER.indexOf(now) + 1) % ORDER.length];
    apply(now);
    try {
      localStorage.setItem(KEY, now);
    } catch {
      // the page works without a memory
    }
  });
})();
