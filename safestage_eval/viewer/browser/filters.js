// The search field and the filters: their values, and what to do when they change.

import { byId, element, spoken } from "./elements.js";

const FILTERS = {
  verdict: "Verdict", stage: "Stage", rule: "Rule", task: "Task", policy: "Policy", prompt: "Prompt", goal: "Goal",
};
const SORTS = { "": "gravest first", task: "by task", policy: "by policy", id: "by name" };

function select(name, label, options) {
  const choices = options.map(([value, text]) => element("option", { value }, text));
  return element("label", {}, label, element("select", { id: `find-${name}` }, ...choices));
}

/** Build the filters that can tell episodes apart; `changed` is called with what is wanted. */
export function makeFilters(table, changed) {
  const kept = wantedNow(), fields = [];
  for (const [name, label] of Object.entries(FILTERS)) {
    const values = table.values(name);
    if (values.length > 1 || (name === "rule" && values.length)) {
      fields.push(select(name, label, [["", "all"], ...values.map((value) => [value, spoken(value)])]));
    }
  }
  fields.push(select("sort", "Order", Object.entries(SORTS)));
  fields.push(element("button", { type: "button", id: "clear-filters" }, "Clear"));
  byId("selects").replaceChildren(...fields);
  setWanted(kept);
  let pause = 0;
  const tell = () => {
    const count = Object.keys(FILTERS).filter((name) => byId(`find-${name}`)?.value).length;
    byId("active-filters").textContent = count ? ` (${count})` : "";
    changed(wantedNow());
  };
  byId("filters").oninput = () => { clearTimeout(pause); pause = setTimeout(tell, 80); };
  byId("filters").onsubmit = (event) => { event.preventDefault(); byId("list").focus(); };
  byId("clear-filters").onclick = () => { setWanted({}); tell(); };
  tell();
}

/** What the fields say: {text, verdict, stage, …, sort}. */
export function wantedNow() {
  const wanted = { text: byId("find-text").value };
  for (const name of [...Object.keys(FILTERS), "sort"]) wanted[name] = byId(`find-${name}`)?.value ?? "";
  return wanted;
}

/** Fill the fields in; values that there are no more are left out. */
export function setWanted(wanted) {
  byId("find-text").value = wanted.text ?? "";
  for (const name of [...Object.keys(FILTERS), "sort"]) {
    const field = byId(`find-${name}`);
    if (!field) continue;
    field.value = wanted[name] ?? "";
    if (field.selectedIndex < 0) field.value = "";
  }
}
