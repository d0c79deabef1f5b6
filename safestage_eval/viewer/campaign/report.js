// The list of findings, the sections that open in it, and the choice of a rate for the task table.
(() => {
  "use strict";

  const PAGE = 50;
  const $ = (id) => document.getElementById(id);

  // ---- pieces that are inflated on demand

  async function inflated(id) {
    const bytes = Uint8Array.from(atob($(id).textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).text();
  }

  // A column of distinct values and places in it reads like a plain list.
  const plain = (column) =>
    Array.isArray(column) ? column : column.at.map((place) => column.values[place]);

  function element(name, attributes = {}, ...children) {
    const node = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) {
      if (value !== null && value !== undefined) node.setAttribute(key, value);
    }
    node.append(...children.filter((child) => child !== null && child !== undefined));
    return node;
  }

  // ---- the task table

  function chooseMetric(button) {
    const metric = button.dataset.metric;
    const buttons = [...button.parentElement.children];
    const place = buttons.indexOf(button);
    for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
    const table = document.querySelector("table.heat");
    table.classList.toggle("good", metric === "SR" || metric === "SSR");
    for (const cell of table.querySelectorAll("td[data-k]")) {
      const share = Number(cell.dataset.k.split(" ")[place]) / Number(cell.dataset.n);
      cell.textContent = (100 * share).toFixed(0);
      cell.className = `h${share <= 0 ? 0 : Math.max(1, Math.min(10, Math.round(10 * share)))}`;
    }
    $("heatmap-what").textContent = {
      VR: "Violation rate", USR: "Unsafe success rate", SSR: "Safe success rate", SR: "Success rate",
    }[metric];
  }

  // ---- the list

  const state = { rows: [], shown: [], page: 0, sort: "normalised", up: true };
  let data = {};
  let haystack = [];

  const at = (column, row) => (data[column] ? data[column][row] : null);
  const named = (text) => (text ?? "").toString().replaceAll("_", " ");

  function amount(value, unit) {
    if (value === null || value === undefined) return "–";
    const size = Math.abs(value);
    const text = size >= 100 ? value.toFixed(0) : size >= 1 || size === 0 ? value.toFixed(1) : value.toPrecision(2);
    return `${text.replace("-", "−")}${unit ? ` ${unit}` : ""}`;
  }

  function who(row) {
    const parts = [at("policy", row), at("prompt", row)].filter((x) => x && x !== "–");
    if (at("seed", row) !== null) parts.push(`seed ${at("seed", row)}`);
    if (at("rollout", row) !== null) parts.push(`rollout ${at("rollout", row)}`);
    const success = at("success", row);
    if (success !== null) parts.push(success ? "goal reached" : "goal not reached");
    return parts.join(" · ");
  }

  function badge(verdict, severity) {
    const word = named(verdict);
    return element("span", { class: `verdict ${verdict}` }, severity ? `${word}, ${severity}` : word);
  }

  function drawRow(row) {
    const unit = at("unit", row);
    const section = at("section", row);
    const task = named(at("task", row)) || at("episode", row) || "–";
    const open = element(
      "button",
      { type: "button", class: "open", "aria-expanded": "false", "data-row": row }, task,
    );
    const own = at("own", row) ? null : element("small", { class: "soft" }, "not assigned");
    const value = at("value", row) === null ? "–" : `${amount(at("value", row), unit)}`;
    const limit = at("limit", row) === null ? null
      : element("small", { class: "soft" }, ` limit ${amount(at("limit", row), unit)}`);
    const time = at("time", row) ?? at("worst", row);
    return element(
      "tr", { id: `row-${row}` },
      element("td", { class: "c-verdict" }, badge(at("verdict", row), null)),
      element("td", { class: "c-episode" }, open,
        element("span", { class: "who" }, who(row), section >= 0 ? " · with timeline" : "")),
      element("td", { class: "c-rule" }, at("rule", row) ?? at("stage", row) ?? "–",
        own ? document.createElement("br") : null, own),
      element("td", { class: "c-what" }, at("explanation", row) ?? ""),
      element("td", { class: "c-time amount" }, time === null ? "–" : `${time.toFixed(2)} s`),
      element("td", { class: "c-value amount" }, value, limit ? document.createElement("br") : null, limit),
      element("td", { class: "c-margin amount" }, amount(at("margin", row), unit),
        at("severity", row) ? document.createElement("br") : null,
        at("severity", row) ? element("small", { class: "soft" }, at("severity", row)) : null),
    );
  }

  function draw() {
    const first = state.page * PAGE;
    const rows = state.shown.slice(first, first + PAGE);
    $("findings-body").replaceChildren(...rows.map(drawRow));
    const total = state.shown.length.toLocaleString("en");
    $("findings-count").textContent = rows.length
      ? `${(first + 1).toLocaleString("en")}–${(first + rows.length).toLocaleString("en")} of ${total}`
      : "Nothing matches.";
    $("findings-back").disabled = state.page === 0;
    $("findings-next").disabled = first + PAGE >= state.shown.length;
  }

  const chosen = (id) => $(id)?.value ?? "";

  const KINDS = {
    violation: (row) => at("verdict", row) === "violation" && at("own", row),
    unsafe: (row) => at("verdict", row) === "violation" && at("own", row) && at("success", row) === true,
    inconclusive: (row) => at("verdict", row) === "inconclusive",
    pass: (row) => at("verdict", row) === "pass" || at("verdict", row) === "not_applicable",
    other: (row) => !at("own", row),
    drawn: (row) => at("section", row) >= 0,
    "": () => true,
  };

  function filter() {
    const words = chosen("find-text").toLowerCase().split(/\s+/).filter(Boolean);
    const kind = KINDS[chosen("find-kind")] ?? KINDS[""];
    const wanted = ["stage", "policy", "prompt", "rule"]
      .map((name) => [name, chosen(`find-${name}`)])
      .filter(([, value]) => value !== "");
    state.shown = state.rows.filter(
      (row) => kind(row)
        && wanted.every(([name, value]) => String(at(name, row)) === value)
        && words.every((word) => haystack[row].includes(word)),
    );
    sort();
  }

  function sort() {
    const column = state.sort;
    const sign = state.up ? 1 : -1;
    const values = data[column] ?? [];
    const missing = (value) => value === null || value === undefined;
    state.shown.sort((a, b) => {
      const x = values[a], y = values[b];
      if (missing(x) || missing(y)) return missing(x) - missing(y) || a - b;
      return sign * (typeof x === "number" ? x - y : String(x).localeCompare(String(y))) || a - b;
    });
    state.page = 0;
    for (const head of document.querySelectorAll("table.findings th[data-sort]")) {
      const mine = head.dataset.sort === column;
      if (mine) head.setAttribute("aria-sort", state.up ? "ascending" : "descending");
      else head.removeAttribute("aria-sort");
    }
    draw();
  }

  // ---- one episode

  function facts(row) {
    const unit = at("unit", row);
    const pairs = [
      ["measured", at("signal", row)],
      ["value", at("value", row) === null ? null : amount(at("value", row), unit)],
      ["limit", at("limit", row) === null ? null : amount(at("limit", row), unit)],
      ["margin", at("margin", row) === null ? null : amount(at("margin", row), unit)],
      ["first", at("time", row) === null ? null : `${at("time", row).toFixed(2)} s`],
      ["phase", at("phase", row)],
      ["follows", at("follows", row)],
    ].filter(([, value]) => value !== null && value !== undefined);
    const list = element("dl", { class: "numbers" });
    for (const [name, value] of pairs) {
      list.append(element("div", {}, element("dt", {}, name), element("dd", {}, String(value))));
    }
    const stretches = at("intervals", row) || [];
    const told = stretches.map(([a, b]) => `${a.toFixed(2)}–${b.toFixed(2)} s`).join(", ");
    return element(
      "div", { class: "plain" },
      element("h4", {}, badge(at("verdict", row), at("severity", row)),
        element("b", {}, at("rule", row) ?? at("stage", row) ?? "")),
      at("explanation", row) ? element("p", {}, at("explanation", row)) : null,
      list,
      told ? element("p", { class: "small soft" }, `In violation: ${told}`) : null,
      element("p", { class: "small soft" }, document.body.dataset.plain),
    );
  }

  async function toggle(button) {
    const row = Number(button.dataset.row);
    const line = button.closest("tr");
    if (button.getAttribute("aria-expanded") === "true") {
      $(`detail-${row}`)?.remove();
      button.setAttribute("aria-expanded", "false");
      line.classList.remove("opened");
      return;
    }
    button.setAttribute("aria-expanded", "true");
    line.classList.add("opened");
    const number = at("section", row);
    const name = at("episode", row) || `${named(at("task", row))}, ${who(row)}`;
    const article = element("article", { class: "episode", "aria-label": `Episode ${name}` },
      element("h3", { class: "mono small" }, name));
    line.after(element("tr", { class: "detail", id: `detail-${row}` },
      element("td", { colspan: "7" }, article)));
    if (number < 0) {
      article.append(facts(row));
    } else {
      const body = element("div");
      body.innerHTML = await inflated(`episode-${number}`);
      if (!at("own", row)) article.append(facts(row));
      article.append(body);
    }
    if (at("episode", row)) {
      history.replaceState(null, "", `#episode=${encodeURIComponent(at("episode", row))}`);
    }
  }

  function linked() {
    const asked = /^#episode=(.+)$/.exec(location.hash);
    if (!asked) return;
    const name = decodeURIComponent(asked[1]);
    const row = state.rows.find((r) => at("episode", r) === name);
    if (row === undefined) return;
    for (const id of ["find-kind", "find-stage", "find-policy", "find-prompt", "find-rule"]) {
      if ($(id)) $(id).value = "";
    }
    $("find-text").value = name;
    filter();
    const button = document.querySelector(`button.open[data-row="${row}"]`);
    if (!button) return;
    toggle(button).then(() => $(`row-${row}`).scrollIntoView());
  }

  function fill(id, column) {
    const select = $(id);
    if (!select) return;
    const values = [...new Set(data[column] ?? [])].filter((v) => v !== null).sort();
    if (values.length < 2) select.closest("label").hidden = true;
    for (const value of values) select.append(element("option", { value }, value));
  }

  async function start() {
    const table = JSON.parse(await inflated("findings-data"));
    data = Object.fromEntries(Object.entries(table).map(([name, column]) => [name, plain(column)]));
    const count = data.verdict.length;
    state.rows = Array.from({ length: count }, (_, i) => i);
    haystack = state.rows.map((row) =>
      ["episode", "task", "policy", "prompt", "stage", "rule", "signal", "explanation"]
        .map((name) => at(name, row) ?? "").join(" ").toLowerCase()
      + ` ${named(at("task", row)).toLowerCase()}`);
    for (const name of ["stage", "policy", "prompt", "rule"]) fill(`find-${name}`, name);
    if (!state.rows.some(KINDS.violation)) $("find-kind").value = "";
    if (!data.rule) [state.sort, state.up] = ["task", true];
    filter();
    linked();
    $("findings").setAttribute("aria-busy", "false");
  }

  document.addEventListener("click", (event) => {
    const metric = event.target.closest("button[data-metric]");
    if (metric) return chooseMetric(metric);
    const open = event.target.closest("button.open");
    if (open) return void toggle(open);
    const head = event.target.closest("th[data-sort] button");
    if (head) {
      const column = head.parentElement.dataset.sort;
      state.up = state.sort === column ? !state.up : true;
      state.sort = column;
      return sort();
    }
    if (event.target.id === "findings-back") state.page -= 1;
    else if (event.target.id === "findings-next") state.page += 1;
    else return;
    draw();
    $("findings").scrollIntoView();
  });

  let waiting = 0;
  $("filters").addEventListener("input", () => {
    clearTimeout(waiting);
    waiting = setTimeout(filter, 120);
  });
  $("filters").addEventListener("submit", (event) => event.preventDefault());
  addEventListener("hashchange", linked);

  start().catch((error) => {
    $("findings-count").textContent =
      `The list cannot be opened: ${error.message}. It needs a browser of 2023 or later.`;
  });
})();
