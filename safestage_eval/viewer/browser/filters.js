// What the list is narrowed to: the outcomes as chips, a search field, filters, an order; all of it in the address.

import { byId, element, spoken } from "./elements.js";
import { WANTED, placeNow, setFilters } from "./page_place.js";

const FILTERS = { verdict: "Verdict", stage: "Stage", rule: "Rule", task: "Task", policy: "Policy", prompt: "Prompt" };
const SORTS = { "": "gravest first", margin: "by margin", time: "by time", rule: "by rule", task: "by task", policy: "by policy", id: "by name" };

const options = (pairs) => pairs.map(([value, text]) => element("option", { value }, text));

function chips(table, press) {
  const counts = table.outcomes(), unsafe = table.goals ? "Unsafe success" : "Violated";
  const names = { unsafe: ["✕", unsafe], safe: ["✓", "Safe"], failed: ["–", "Failed"], open: ["?", ""] };
  const shown = Object.entries(names).filter(([name]) => table.goals || name !== "failed");
  byId("chips").replaceChildren(...shown.map(([name, [sign, word]]) => {
    const chip = element("button", { type: "button", class: `chip ${name}`, "data-outcome": name,
      "aria-label": `${word || "Undecided"}: ${counts[name]}` }, element("span", { class: "sign" }, sign), word, element("b", {}, counts[name]));
    chip.onclick = () => press(name);
    return chip;
  }));
}

/** Build what can tell episodes apart; `changed` is called with what is wanted. Returns what asks for something else. */
export function makeFilters(table, changed) {
  const fields = [];
  for (const [name, label] of Object.entries(FILTERS)) {
    const values = table.values(name);
    if (values.length < 2 && !(name === "rule" && values.length)) continue;
    const choices = options([["", "all"], ...values.map((value) => [value, spoken(value)])]);
    fields.push(element("label", {}, label, element("select", { id: `find-${name}` }, ...choices)));
  }
  fields.push(element("button", { type: "button", id: "clear-filters" }, "Clear"));
  byId("selects").replaceChildren(...fields);
  byId("find-sort").replaceChildren(...options(Object.entries(SORTS)));
  let pause = 0;
  const tell = () => {
    byId("list").scrollTop = 0;
    const wanted = wantedNow(), count = Object.keys(FILTERS).filter((name) => wanted[name]).length;
    byId("active-filters").textContent = count ? ` (${count})` : "";
    for (const chip of byId("chips").children) chip.setAttribute("aria-pressed", String(chip.dataset.outcome === wanted.outcome));
    setFilters(wanted);
    changed(wanted);
  };
  chips(table, (name) => {
    const { dataset } = byId("chips");
    dataset.outcome = dataset.outcome === name ? "" : name;
    document.body.classList.remove("opened");
    tell();
  });
  byId("filters").oninput = () => { clearTimeout(pause); pause = setTimeout(tell, 80); };
  byId("find-sort").onchange = tell;  // it stands beside the form
  byId("filters").onsubmit = (event) => { event.preventDefault(); byId("list").focus(); };
  byId("clear-filters").onclick = () => ask({});
  const ask = (wanted) => { setWanted(wanted); tell(); };
  ask(placeNow().wanted ?? {});
  return ask;
}

// What the fields say: {text, outcome, verdict, stage, …, sort}.
function wantedNow() {
  return Object.fromEntries(WANTED.map((name) =>
    [name, (name === "outcome" ? byId("chips").dataset.outcome : byId(`find-${name}`)?.value) ?? ""]));
}

// Fill the fields in; values that there are no more are left out.
function setWanted(wanted) {
  for (const name of WANTED) {
    const field = byId(`find-${name}`);
    if (field) field.value = wanted[name] ?? "";
    if (field?.selectedIndex < 0) field.value = "";
  }
  byId("chips").dataset.outcome = wanted.outcome ?? "";
}
