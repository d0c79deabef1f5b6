// The picture with its controls: the replay in 3-D or the camera film, the time, speed and view, the legend of roles.

import { element, seconds, spoken } from "./elements.js";
import { library, piece } from "./pieces.js";
import { sharedMesh } from "./film.js";
import { SafestageReplay } from "./replay.js";
import { swatchOf } from "./role_marks.js";
import { colourNow } from "./theme_colours.js";
import { WitnessDrawing } from "./witness_drawing.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
const meshes = new Map();  // name of a piece -> mesh

/** The meshes that a film has in common with others, loaded. */
async function meshesOf(head) {
  const names = head.meshes.map((mesh) => mesh.key).filter((key) => key !== undefined && !meshes.has(key));
  await Promise.all(names.map(async (name) => meshes.set(name, sharedMesh(await piece(name)))));
  return meshes;
}

export class PlayerPanel {
  /** `onTime` is called with the time whenever it changes. */
  constructor(onTime) {
    this.onTime = onTime; this.replay = null; this.drawing = null; this.time = 0; this.start = 0; this.end = 1;
    this.canvas = element("canvas", { tabindex: "0", role: "img", "aria-label":
      "3-D replay. Arrow keys turn the view, plus and minus bring it nearer and farther, zero resets it." });
    this.tags = element("div", { class: "tags", "aria-hidden": "true" });
    this.blank = element("p", { class: "blank", role: "status", hidden: true });
    this.video = element("video", { muted: true, playsinline: true, preload: "metadata", "aria-label": "Camera film", hidden: true });
    this.button = element("button", { type: "button", class: "play", "aria-keyshortcuts": "Space" }, "Play");
    this.clock = element("output", { class: "number clock" }, "0.00 s");
    this.speed = element("select", { "aria-label": "Speed" },
      ...SPEEDS.map((x) => element("option", { value: x, selected: x === 1 }, `${x} ×`)));
    this.looks = element("span", { class: "looks", role: "group", "aria-label": "View" },
      ...["front", "side", "back", "top"].map((name) => element("button", { type: "button", class: "quiet", "data-look": name }, name)));
    this.names = element("button", { type: "button", class: "quiet", "aria-pressed": "true" }, "names");
    this.source = element("button", { type: "button", class: "quiet", hidden: true }, "camera film");
    this.legend = element("ul", { class: "legend", "aria-label": "Roles" });
    this.node = element("section", { class: "player", "aria-label": "Replay" },
      element("div", { class: "screen" }, this.canvas, this.tags, this.video, this.blank),
      element("div", { class: "controls no-print" }, this.button, this.clock, this.speed, this.looks, this.names, this.source),
      this.legend);
    this._listen();
  }

  _listen() {
    this.button.onclick = () => this.toggle();
    this.speed.onchange = () => this._setSpeed();
    this.looks.onclick = (event) => { const look = event.target.dataset.look; if (look) this.replay?.look(look); };
    this.names.onclick = () => {
      this.tags.classList.toggle("nameless");
      this.names.setAttribute("aria-pressed", String(!this.tags.classList.contains("nameless")));
    };
    this.source.onclick = () => this._show(this.video.hidden ? "video" : "replay");
    this.video.onseeking = this.video.ontimeupdate = () => { if (!this.video.hidden) this._moved(this._filmTime()); };
    this.video.onplay = this.video.onpause = () => this._playing(!this.video.paused);
    this.video.onerror = () => { if (!this.video.hidden) this._fail("The camera film cannot be played here."); };
  }

  /** Show an episode: its evidence, the buffer of its film, and the address of a camera film. */
  async open(data, buffer, head, film) {
    this.close();
    Object.assign(this, { start: data.start, end: data.end, data, time: data.start });
    this.blank.hidden = true;
    this.legend.replaceChildren(...Object.entries(data.roles).map(([role, bodies]) => element("li", {},
      element("span", { class: swatchOf(role, JSON.parse(document.body.dataset.hatchings)) }),
      `${spoken(role)}: ${bodies.map(spoken).join(", ")}`)));
    this.source.hidden = !film;
    if (film) this.video.src = film; else this.video.removeAttribute("src");
    this._show("replay");
    try {
      await library("three");
      const shared = await meshesOf(head);
      if (this.data !== data) return;
      this.replay = new SafestageReplay(this.canvas, buffer, {
        tags: this.tags, shared, onTime: (time) => this._moved(time), onState: (playing) => this._playing(playing),
      });
      this._setSpeed();
    } catch (error) {
      this._fail(`There is no 3-D picture: ${error.message}. The findings below are complete all the same.`);
    }
  }

  close() {
    this.drawing?.dispose(); this.drawing = null;
    this.replay?.dispose(); this.replay = null;
    this.video.pause();
    this._playing(false);
  }

  /** Draw the witness of a finding, or none. */
  point(finding) {
    if (this.drawing?.finding === finding) return;
    this.drawing?.dispose(); this.drawing = null;
    if (this.replay && finding?.witness) this.drawing = new WitnessDrawing(this.replay, finding, this.tags);
    this.replay?.draw();
  }

  _fail(words) { this.blank.textContent = words; this.blank.hidden = false; }

  _show(which) {
    const video = which === "video";
    this.pause();
    this.video.hidden = !video;
    for (const node of [this.canvas, this.tags, this.looks, this.names]) node.hidden = video;
    this.source.textContent = video ? "3-D" : "camera film";
    this.seek(this.time);
  }

  _filmTime() {
    const { begin, pace } = this.data.clock;
    return Math.min(begin + this.video.currentTime / pace, this.end);
  }

  _setSpeed() {
    const speed = Number(this.speed.value);
    if (this.replay) this.replay.speed = speed;
    this.video.playbackRate = this.video.defaultPlaybackRate = speed * (this.data?.clock.pace ?? 1);
  }

  _playing(yes) {
    this.playing = yes;
    this.button.textContent = yes ? "Pause" : "Play";
  }

  _moved(time) {
    this.time = time;
    this.clock.textContent = seconds(time);
    this.onTime(time);
  }

  toggle() { if (this.playing) this.pause(); else this.play(); }

  play() {
    if (!this.video.hidden) this.video.play().catch(() => this._fail("The camera film cannot be played here."));
    else this.replay?.play();
  }

  pause() { this.video.pause(); this.replay?.pause(); }

  seek(time) {
    const at = Math.min(Math.max(time, this.start), this.end);
    if (!this.video.hidden) this.video.currentTime = Math.max(at - this.data.clock.begin, 0) * this.data.clock.pace;
    if (this.replay && !this.canvas.hidden) this.replay.seek(at); else this._moved(at);
  }

  /** Paint bodies that violate something now. */
  tint(names) {
    if (!this.replay) return;
    const { tints } = this.replay;
    let changed = false;
    for (const { name } of this.replay.film.bodies) {
      const wanted = names.has(name) ? colourNow("violation") : null;
      if ((tints[name] ?? null) !== wanted) { tints[name] = wanted; changed = true; }
    }
    for (const { body, element: tag } of this.replay.tags) tag.classList.toggle("bad", names.has(body.name));
    if (changed) this.replay.draw();
  }
}
