// SafestageReplay: plays a film of an episode (safestage_eval/viewer/film.py) on a canvas, with three.js.
// World frame, metres, z up; quaternions w x y z. The canvas's background is the sky.
//
//   const replay = new SafestageReplay(canvas, arrayBuffer, {onTime, onState, tags, shared});
//   replay.play(); replay.pause(); replay.seek(3.2); replay.speed = 0.25; replay.look("top");
//   replay.tint("cup", [r, g, b]); replay.project(replay.pose(body)); replay.dispose();
//
// tags: an element over the canvas, of the same size, for the names of the bodies that have a role.
// Keys on the focused canvas: arrows turn the view, + and - bring it nearer and farther, 0 resets it.

import { filmOf, poseAt } from "./film.js";
import { surfaceOf, unbroken } from "./body_surface.js";
import { hatch, outlining } from "./role_marks.js";
import { lit, stageOf } from "./stage_light.js";
import { colourNow, onColours } from "./theme_colours.js";
import { canvasInput } from "./canvas_input.js";

const LOOKS = { front: [0, 0], side: [-0.9, 0.2], back: [2.4, 0], top: [0.35, -0.97] };

export class SafestageReplay {
  /** Raises Error where the browser has no WebGL 2. */
  constructor(canvas, buffer, { onTime = () => {}, onState = () => {}, tags = null, shared } = {}) {
    Object.assign(this, { canvas, onTime, onState, tags: [], tints: {}, onDraw: [] });
    Object.assign(this, stageOf(canvas));
    this.film = filmOf(buffer, shared);
    this.start = this.film.times[0]; this.end = this.film.times.at(-1);
    this.time = this.start; this.speed = 1; this.playing = false;
    this.off = new AbortController();
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(41, 1, 0.02, 30);
    this.camera.up.set(0, 0, 1);
    lit(this.scene, this.film.look.at);
    this.ink = new THREE.Color();
    this.parts = this.film.bodies.map((body) => this._part(body)).filter(Boolean);
    if (tags) this.tags = this.film.bodies.filter((body) => body.roles.length).map((body) => this._tag(body, tags));
    canvasInput(this, this.off.signal);
    onColours(() => this.draw(), this.off.signal);
    this.look("front");
    this.resize = new ResizeObserver(() => this.draw()); this.resize.observe(canvas);
  }

  // ---- time

  play() {
    if (this.time >= this.end) this.time = this.start;
    this.playing = true; this.onState(true);
    let last = performance.now();
    const beat = (now) => {
      if (!this.playing) return;
      this.time = Math.min(this.time + this.speed * (now - last) / 1000, this.end); last = now;
      this.draw(); this.onTime(this.time);
      if (this.time >= this.end) this.pause(); else this.frame = requestAnimationFrame(beat);
    };
    cancelAnimationFrame(this.frame); this.frame = requestAnimationFrame(beat);
  }

  pause() { this.playing = false; cancelAnimationFrame(this.frame); this.onState(false); }

  seek(time) { this.time = Math.min(Math.max(time, this.start), this.end); this.draw(); this.onTime(this.time); }

  // ---- the eye

  /** front, side, back, top; or {at, distance, azimuth, elevation}. */
  look(view) {
    const home = this.film.look, away = LOOKS[view];
    const [round, up] = away ?? [0, 0];
    this.eye = { ...home, at: [...home.at], azimuth: home.azimuth + round, elevation: home.elevation + up };
    if (!away) Object.assign(this.eye, view);
    this.draw();
  }

  orbit(azimuth, elevation) {
    this.eye.azimuth += azimuth;
    this.eye.elevation = Math.min(Math.max(this.eye.elevation + elevation, -1.55), 0.3);
    this.draw();
  }

  zoom(factor) { this.eye.distance = Math.min(Math.max(this.eye.distance * factor, 0.1), 8); this.draw(); }

  pan(dx, dy) {
    const { azimuth, distance, at } = this.eye, scale = distance / this.canvas.clientHeight;
    at[0] -= Math.sin(azimuth) * dx * scale; at[1] += Math.cos(azimuth) * dx * scale; at[2] += dy * scale;
    this.draw();
  }

  /** Another colour for a body, [r, g, b] of 0 … 1 or a CSS colour; null gives it its own again. */
  tint(name, colour) { this.tints[name] = colour; this.draw(); }

  dispose() {
    this.pause(); this.off.abort(); this.resize.disconnect();
    for (const { element } of this.tags) element.remove();
    this.scene.traverse((node) => { node.geometry?.dispose(); node.material?.dispose(); });
  }

  // ---- the picture

  _part(body) {
    const surface = surfaceOf(body, this.film.meshes);
    if (!surface) return null;
    const glass = body.kind === "region", floor = body.geoms.every((geom) => geom.kind === "plane");
    const material = new THREE.MeshLambertMaterial(glass ? { transparent: true, opacity: 0.3, depthWrite: false, side: THREE.DoubleSide } : {});
    const mesh = new THREE.Mesh(surface, material), group = new THREE.Group();
    mesh.castShadow = !glass && !floor; mesh.receiveShadow = !glass;
    group.add(mesh);
    if (body.roles.length && !floor && !glass) {
      hatch(material, body.hatching, this.ink, this.fine);
      group.add(new THREE.Mesh(unbroken(surface), outlining(this.ink)));
    }
    this.scene.add(group);
    return { body, group, material, kind: floor ? "floor" : body.kind };
  }

  /** [x, y, z, w, x, y, z] of a body now. */
  pose(body) { return poseAt(this.film, body, this.time); }

  /** Where a world point is on the canvas, in CSS pixels, after the last draw; null behind the eye. */
  project([x, y, z]) {
    const { clientWidth, clientHeight } = this.canvas, p = new THREE.Vector3(x, y, z);
    if (p.clone().applyMatrix4(this.camera.matrixWorldInverse).z >= 0) return null;
    p.project(this.camera);
    return [(p.x + 1) / 2 * clientWidth, (1 - p.y) / 2 * clientHeight];
  }

  _tag(body, layer) {
    const element = document.createElement("span");
    element.textContent = `${body.name.replaceAll("_", " ")} (${body.roles.join(", ")})`;
    layer.append(element);
    return { body, element };
  }

  /** Put an element of the layer of tags at a world point, or hide it. */
  placeTag(element, point) {
    const at = point && this.project(point);
    const inside = at && at[0] > 0 && at[1] > 0 && at[0] < this.canvas.clientWidth && at[1] < this.canvas.clientHeight;
    element.hidden = !inside;
    if (inside) element.style.transform = `translate(-50%, -50%) translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px)`;
  }

  draw() {
    const { canvas, eye, renderer, camera } = this, { clientWidth: width, clientHeight: height } = canvas;
    if (!width || !height || !eye || this.off.signal.aborted) return;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;  // 41 degrees high, or wide where the canvas is upright
    camera.fov = camera.aspect >= 1 ? 41 : 2 * Math.atan(Math.tan(0.358) / camera.aspect) * 180 / Math.PI;
    camera.updateProjectionMatrix();
    const flatly = Math.cos(eye.elevation);
    const forward = [flatly * Math.cos(eye.azimuth), flatly * Math.sin(eye.azimuth), Math.sin(eye.elevation)];
    camera.position.set(...eye.at.map((x, k) => x - eye.distance * forward[k]));
    camera.lookAt(...eye.at);
    camera.updateMatrixWorld();
    this.ink.setStyle(colourNow("mark-ink"));
    const colours = {};
    for (const { body, group, material, kind } of this.parts) {
      const [x, y, z, w, a, b, c] = this.pose(body), tint = this.tints[body.name];
      group.position.set(x, y, z); group.quaternion.set(a, b, c, w).normalize();
      if (Array.isArray(tint)) material.color.setRGB(...tint);
      else material.color.setStyle(tint ?? (colours[kind] ??= colourNow(`kind-${kind}`)));
    }
    for (const act of this.onDraw) act(this);
    renderer.render(this.scene, camera);
    this._placeTags();
  }

  /** Names stand below each other where they would cover each other. */
  _placeTags() {
    const { clientWidth, clientHeight } = this.canvas, taken = [];
    const spots = this.tags.map(({ body, element }) => ({ element, at: this.project(this.pose(body)) }));
    spots.sort((a, b) => (a.at?.[1] ?? 0) - (b.at?.[1] ?? 0));
    for (const { element, at } of spots) {
      const inside = at && at[0] > 0 && at[1] > 0 && at[0] < clientWidth && at[1] < clientHeight;
      element.hidden = !inside;
      if (!inside) continue;
      const half = 4 * element.textContent.length;
      let [x, y] = [at[0], at[1] + 24];  // below the body
      x = Math.min(Math.max(x, half), clientWidth - half);
      for (const [left, right, above] of taken) if (x + half > left && x - half < right && y < above + 20 && y > above - 20) y = above + 20;
      taken.push([x - half, x + half, y]);
      element.style.transform = `translate(-50%, -50%) translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
    }
  }
}
