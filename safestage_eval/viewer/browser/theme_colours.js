// Colours of the page's palette as the browser resolves them now: light, dark or paper.

/** "rgb(…)" of a custom property such as "violation". */
export function colourNow(name) {
  const probe = document.createElement("i");
  probe.style.color = `var(--${name})`;
  probe.hidden = true;
  document.body.append(probe);
  const found = getComputedStyle(probe).color;
  probe.remove();
  return found;
}

/** Call `act` whenever the colours change, until the signal aborts. */
export function onColours(act, signal) {
  const watch = new MutationObserver(act);
  watch.observe(document.documentElement, { attributes: true, attributeFilter: ["data-theme"] });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", act, { signal });
  signal.addEventListener("abort", () => watch.disconnect());
}
