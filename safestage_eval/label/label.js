/* The labelling page. What it shows comes from the server by number: it knows no id, no policy and no
   verdict. An answer counts when the server has it on disk; only then does the page go on. */
(() => {
  "use strict";
  const $ = (id) => document.getElementById(id);
  const app = $("app"), total = Number(app.dataset.total);
  const hatchings = JSON.parse(document.body.dataset.hatchings);
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  const state = { reviewer: null, answers: [], number: 0, player: null, busy: false };
  const kept = new Map();  // number -> promise of what is asked and of its film

  // ---- the server

  async function ask(path, options) {
    let response;
    try {
      response = await fetch(path, options);
    } catch {
      throw new Error("the command “safestage label” has ended: start it again, then reload this page");
    }
    if (response.ok) return response;
    const { error } = await response.json().catch(() => ({ error: response.statusText }));
    throw new Error(error);
  }

  function load(number) {
    if (!kept.has(number)) {
      const item = ask(`/rollout/${number}`).then((r) => r.json());
      const film = ask(`/rollout/${number}/film`).then((r) => r.arrayBuffer());
      film.catch(() => {});
      item.catch(() => kept.delete(number));
      kept.set(number, { item, film });
      while (kept.size > 4) kept.delete(kept.keys().next().value);
    }
    return kept.get(number);
  }

  function alarm(text) {
    $("alert").textContent = text;
    $("alert").hidden = !text;
  }

  // ---- players: a video, or the replay; both have start, end, time, playing and the like

  class Film {
    constructor(video, item, number) {
      Object.assign(this, { video, start: 0, end: 0 });
      this.off = new AbortController();
      const on = (name, act) => video.addEventListener(name, act, { signal: this.off.signal });
      on("loadedmetadata", () => { this.end = video.duration; shown(); });
      for (const name of ["timeupdate", "seeked"]) on(name, shown);
      for (const name of ["play", "pause", "ended"]) on(name, shown);
      on("error", () => { $("blank").textContent = "The video cannot be played here."; $("blank").hidden = false; });
      video.src = `/rollout/${number}/video`;
    }
    get time() { return this.video.currentTime; }
    get playing() { return !this.video.paused && !this.video.ended; }
    play() { this.video.play().catch(() => {}); }
    pause() { this.video.pause(); }
    seek(time) { this.video.currentTime = Math.min(Math.max(time, 0), this.end || 0); }
    set speed(value) { this.video.defaultPlaybackRate = this.video.playbackRate = value; }
    dispose() { this.off.abort(); this.video.pause(); this.video.removeAttribute("src"); this.video.load(); }
  }

  function close() {
    state.player?.dispose();
    state.player = null;
  }

  async function open(number, item, wanted) {
    close();
    const video = wanted === "video";
    for (const [id, there] of [["video", video], ["canvas", !video], ["tags", !video], ["angles", !video], ["names", !video]]) $(id).hidden = !there;
    if (!video) $("tags").hidden = $("names").getAttribute("aria-pressed") !== "true";
    $("source").hidden = !item.video;
    $("source").textContent = video ? "Show in 3-D" : "Show the video";
    $("blank").hidden = true;
    try {
      if (video) state.player = new Film($("video"), item, number);
      else {
        const film = await load(number).film;
        if (state.number !== number) return;
        state.player = new SafestageReplay($("canvas"), film, { onTime: shown, onState: shown, tags: $("tags") });
      }
    } catch (error) {
      $("blank").textContent = `There is no picture: ${error.message}.`;
      $("blank").hidden = false;
      return;
    }
    state.player.speed = Number($("speed").value);
    shown();
    if (!calm.matches) state.player.play();
  }

  function shown() {
    const player = state.player;
    if (!player) return;
    const goal = state.item.success_time, length = player.end - player.start;
    $("seek").min = player.start; $("seek").max = player.end; $("seek").value = player.time;
    const text = `${player.time.toFixed(1)} s of ${player.end.toFixed(1)} s`;
    $("time").textContent = text.replace(" s of", " /");
    $("seek").setAttribute("aria-valuetext", text);
    $("play").textContent = player.playing ? "Pause" : "Play";
    const marked = goal !== null && length > 0 && goal >= player.start && goal <= player.end && !$("canvas").hidden;
    $("goal").hidden = !marked;
    if (marked) $("goal").style.left = `calc(8px + (100% - 16px) * ${(goal - player.start) / length} - 1px)`;
  }

  // ---- what is asked

  function made(tag, text, className) {
    const element = document.createElement(tag);
    if (text) element.textContent = text;
    if (className) element.className = className;
    return element;
  }

  function list(items, className) {
    const element = made("ul", "", className);
    element.append(...items);
    return element;
  }

  function tell(item) {
    $("task").textContent = item.instruction || "A task without an instruction";
    $("goal-said").textContent = item.success === null ? ""
      : !item.success ? "The goal was not reached."
        : item.success_time === null ? "The goal was reached."
          : `The goal was reached at ${item.success_time.toFixed(1)} s.`;
    const parts = [];
    if (item.rules.length) parts.push(made("h3", item.rules.length > 1 ? "Safe means all of this" : "Safe means"));
    if (item.look) parts.push(made("p", item.look, "soft small"));
    for (const rule of item.rules) {
      const title = made("p");
      title.append(made("strong", `${rule.title}.`));
      parts.push(title, made("p", rule.why));
      const facts = [["always", rule.always], ["never", rule.never], ["at some time", rule.once]]
        .flatMap(([word, texts]) => texts.map((text) => made("li", `${word}: ${text}`)));
      if (facts.length) {
        const details = made("details", "", "small");
        details.append(made("summary", "In numbers"), list([made("li", `judged ${rule.judged}`), ...facts]));
        parts.push(details);
      }
    }
    if (item.unknown.length) parts.push(made("p", `Also asked, but its rule is not loaded: ${item.unknown.join(", ")}.`));
    if (!item.rules.length) parts.push(made("p", "No requirement is known for this rollout. Judge by common sense, or answer “unsure”."));
    const roles = Object.entries(item.roles);
    if (roles.length) {
      parts.push(made("h3", "Who is who"), list(roles.map(([role, bodies]) => {
        const entry = made("li"), swatch = made("span", "", `swatch hatch-${hatchings[role] ?? "plain"}`);
        entry.append(swatch, made("span", `${role}: ${bodies.join(", ").replaceAll("_", " ")}`));
        return entry;
      }), "roles"));
    }
    $("requirement").replaceChildren(...parts);
  }

  function mark() {
    const answers = state.answers.filter(Boolean).length, own = state.answers[state.number];
    $("progress").value = answers;
    $("count").textContent = `${answers} of ${total} answered`;
    $("where").textContent = `Rollout ${state.number + 1} of ${total}`;
    for (const button of document.querySelectorAll("[data-answer]"))
      button.setAttribute("aria-pressed", String(own?.label === button.dataset.answer));
    $("back").disabled = state.number === 0;
    $("next").disabled = state.number === total - 1 && answers < total;
    $("next").textContent = state.number === total - 1 ? "Finish" : "Next";
  }

  async function show(number) {
    keepNote();
    state.number = number;
    for (const id of ["who", "done"]) $(id).hidden = true;
    $("work").hidden = false;
    history.replaceState(null, "", `#${number + 1}`);
    mark();
    $("note").value = state.answers[number]?.note ?? "";
    let item;
    try {
      item = await load(number).item;
    } catch (error) {
      close();
      $("blank").textContent = `${error.message}.`;
      $("blank").hidden = false;
      return;
    }
    if (state.number !== number) return;
    state.item = item;
    tell(item);
    await open(number, item, item.video ? "video" : "film");
    app.dataset.shown = number;
    const next = following(number);
    if (next !== null) load(next);
  }

  /** The next rollout without an answer, round and round; null if there is none. */
  function following(from) {
    for (let i = 1; i <= total; i++) if (!state.answers[(from + i) % total]) return (from + i) % total;
    return null;
  }

  // ---- answers

  async function send(number, label, note) {
    const body = JSON.stringify({ rollout: number, label, note, reviewer: state.reviewer });
    const response = await ask("/answer", { method: "POST", headers: { "Content-Type": "application/json" }, body });
    take(await response.json());
  }

  function take({ answers, commands }) {
    state.answers = answers; state.commands = commands;
  }

  async function answer(label) {
    if (state.busy || $("work").hidden) return;
    state.busy = true; alarm("");
    const number = state.number;
    try {
      await send(number, label, $("note").value);
    } catch (error) {
      state.busy = false;
      alarm(`Not saved: ${error.message}.`);
      return;
    }
    state.busy = false;
    mark();
    const next = following(number);
    $("said").textContent = `Rollout ${number + 1} saved as ${label}. ${next === null ? "All answered." : `Now rollout ${next + 1}.`}`;
    if (next === null) finish();
    else { await show(next); $("task").focus({ preventScroll: true }); }
  }

  /** A note that was changed after its answer is kept as well. */
  function keepNote() {
    const number = state.number, own = state.answers[number], note = $("note").value.trim();
    if ($("work").hidden || !own || own.note === note) return;
    own.note = note;
    send(number, own.label, note).then(() => { $("said").textContent = "Note saved."; }, (error) => alarm(`Note not saved: ${error.message}.`));
  }

  function finish() {
    close();
    for (const id of ["work", "who"]) $(id).hidden = true;
    $("done").hidden = false;
    const counts = ["safe", "unsafe", "unsure"].map((label) => `${state.answers.filter((x) => x.label === label).length} ${label}`);
    $("summary").textContent = `${counts.join(", ")}. Every answer is saved. You may close this page.`;
    $("commands").replaceChildren(...(state.commands.length ? [made("p", "How far people and evaluator agree, the terminal tells next:"), made("pre", state.commands.join("\n"))] : []));
    $("done-title").focus();
  }

  // ---- reviewers

  const memory = {
    get name() { try { return sessionStorage.getItem("safestage-reviewer"); } catch { return null; } },
    set name(value) { try { sessionStorage.setItem("safestage-reviewer", value); } catch { /* it asks again after a reload */ } },
  };

  async function begin(name) {
    let found;
    try {
      found = await (await ask(`/state?reviewer=${encodeURIComponent(name)}`)).json();
    } catch (error) {
      alarm(`${error.message}.`);
      return;
    }
    alarm("");
    state.reviewer = memory.name = name;
    take(found);
    $("reviewer").textContent = `Reviewer: ${name}`;
    $("reviewer").hidden = false;
    const asked = Number(location.hash.slice(1)) - 1, left = following(total - 1);
    if (asked >= 0 && asked < total && Number.isInteger(asked) && left !== null) await show(asked);
    else if (left === null) { mark(); finish(); } else await show(left);
  }

  function whoIsThere() {
    keepNote();
    close();
    for (const id of ["work", "done"]) $(id).hidden = true;
    $("who").hidden = false; $("reviewer").hidden = true;
    history.replaceState(null, "", "#");
    state.answers = []; $("count").textContent = ""; $("progress").value = 0;
    $("name").value = ""; $("name").focus();
  }

  // ---- hands

  $("name-form").addEventListener("submit", (event) => { event.preventDefault(); begin($("name").value.trim().replace(/\s+/g, " ")); });
  for (const id of ["reviewer", "other"]) $(id).addEventListener("click", whoIsThere);
  if (app.dataset.reviewer !== undefined) { $("reviewer").disabled = true; $("other").hidden = true; }
  $("again").addEventListener("click", () => show(0));
  $("back").addEventListener("click", () => step(-1));
  $("next").addEventListener("click", () => step(1));
  $("play").addEventListener("click", toggle);
  $("seek").addEventListener("input", () => { state.player?.pause(); state.player?.seek(Number($("seek").value)); });
  $("speed").addEventListener("change", () => { if (state.player) state.player.speed = Number($("speed").value); });
  $("source").addEventListener("click", () => open(state.number, state.item, $("video").hidden ? "video" : "film"));
  $("names").addEventListener("click", () => {
    $("tags").hidden = $("names").getAttribute("aria-pressed") === "true";
    $("names").setAttribute("aria-pressed", String(!$("tags").hidden));
  });
  $("note").addEventListener("change", keepNote);
  for (const button of document.querySelectorAll("[data-look]")) button.addEventListener("click", () => state.player?.look?.(button.dataset.look));
  for (const button of document.querySelectorAll("[data-answer]")) button.addEventListener("click", () => answer(button.dataset.answer));

  function step(by) {
    const number = state.number + by;
    if (number >= 0 && number < total) show(number);
    else if (by > 0 && following(0) === null) { keepNote(); finish(); }
  }

  function toggle() {
    if (state.player) state.player.playing ? state.player.pause() : state.player.play();
  }

  function seek(by) {
    state.player?.pause();
    state.player?.seek(state.player.time + by);
  }

  const LETTERS = { s: () => answer("safe"), u: () => answer("unsafe"), x: () => answer("unsure"), n: () => $("note").focus() };

  document.addEventListener("keydown", (event) => {
    if ($("work").hidden || event.ctrlKey || event.metaKey || event.altKey) return;
    const { target, key } = event, typing = target === $("note");
    if (typing) { if (key === "Escape") $("task").focus(); return; }
    const letter = $("letters").checked && !event.shiftKey && !event.repeat && target.tagName !== "SELECT" && LETTERS[key.toLowerCase()];
    const acts = {
      " ": !["BUTTON", "SUMMARY", "SELECT"].includes(target.tagName) && target.type !== "checkbox" && toggle,
      ArrowLeft: !["SELECT"].includes(target.tagName) && (() => seek(event.shiftKey ? -1 / 15 : -1)),
      ArrowRight: !["SELECT"].includes(target.tagName) && (() => seek(event.shiftKey ? 1 / 15 : 1)),
      PageUp: () => step(-1), PageDown: () => step(1),
    };
    const act = letter || acts[key];
    if (act) { event.preventDefault(); act(); }
  });

  const given = app.dataset.reviewer ?? memory.name;
  if (given) begin(given); else whoIsThere();
})();
