// Keys of the whole page; a field or a button that has the focus keeps its own.

import { byId } from "./elements.js";
import { showResults } from "./results_view.js";

/** Listen; `acts` has what the keys do: {step, toggle, nudge, violation, back}. */
export function makeKeyboard(acts) {
  const help = byId("help");
  byId("open-help").onclick = () => help.showModal();
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || help.open || event.defaultPrevented) return;
    const { target, key } = event, typing = target.matches("input[type=search], select, textarea");
    if (typing) {
      if (key === "Escape") { byId("list").focus(); event.preventDefault(); }
      else if (key === "ArrowDown" && target.id === "find-text") { byId("list").focus(); event.preventDefault(); }
      return;
    }
    const pressed = target.matches("button, summary, a");
    const act = {
      j: () => acts.step(1), k: () => acts.step(-1), ArrowDown: () => acts.step(1), ArrowUp: () => acts.step(-1),
      Home: target.id === "list" && (() => acts.end(-1)), End: target.id === "list" && (() => acts.end(1)),
      Enter: !pressed && target.id === "list" && acts.enter,
      " ": !pressed && acts.toggle,
      ArrowLeft: () => acts.nudge(event.shiftKey ? -1 / 15 : -1), ArrowRight: () => acts.nudge(event.shiftKey ? 1 / 15 : 1),
      ",": () => acts.nudge(-1 / 15), ".": () => acts.nudge(1 / 15),
      v: acts.violation, "/": () => { showResults(false); acts.back(); byId("find-text").focus(); byId("find-text").select(); },
      "?": () => help.showModal(), Escape: acts.back,
      r: document.body.dataset.results && (() => showResults(byId("results").hidden)),
    }[key];
    if (!act) return;
    if (!byId("results").hidden && !["r", "?", "/"].includes(key)) return;  // reading scrolls
    event.preventDefault();
    act();
  });
}
