// The witness of a finding in the picture: the shortest segment between two bodies with its length, the limit as
// a shell around the one that is guarded; the way that a body has gone; or what is measured, where it is.

import { poseAt } from "./film.js";
import { convexParts, nearestOf, placed } from "./convex.js";
import { outlineOf, shellOf } from "./limit_shell.js";
import { colourNow } from "./theme_colours.js";
import { amount, spoken } from "./elements.js";

const TOUCHED = { contact_force: "", peak_force: "peak", moved_by_touch: "shoved", displacement: "moved" };  // signal -> in words
const ALWAYS = 10;  // drawn after everything else

function rod(material) {
  const mesh = new THREE.Mesh(new THREE.CylinderGeometry(1, 1, 1, 10), material);
  mesh.renderOrder = ALWAYS;
  return mesh;
}

function stretch(mesh, from, to, thick) {
  const a = new THREE.Vector3(...from), b = new THREE.Vector3(...to), way = b.clone().sub(a), long = way.length();
  mesh.position.copy(a).addScaledVector(way, 0.5);
  mesh.scale.set(thick, Math.max(long, 1e-6), thick);
  if (long > 1e-9) mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.divideScalar(long));
}

export class WitnessDrawing {
  /** Of a finding's witness on a replay; `tags` is the layer of names. */
  constructor(replay, finding, tags) {
    Object.assign(this, { replay, witness: finding.witness, finding, parts: new Map() });
    this.group = new THREE.Group();
    this.ink = new THREE.MeshBasicMaterial({ depthTest: false, transparent: true });
    this.glass = new THREE.MeshLambertMaterial({ transparent: true, opacity: 0.26, depthWrite: false });
    this.depth = new THREE.MeshBasicMaterial({ colorWrite: false });  // first: then only the nearest shell is seen
    this.rod = rod(this.ink);
    this.ends = [0, 1].map(() => {
      const ball = new THREE.Mesh(new THREE.SphereGeometry(1, 14, 10), this.ink);
      ball.renderOrder = ALWAYS;
      return ball;
    });
    this.group.add(this.rod, ...this.ends);
    this.label = document.createElement("b");
    this.label.className = "length";
    tags.append(this.label);
    this.bodies = new Map(replay.film.bodies.map((body) => [body.name, body]));
    this.shells = this._shells();
    replay.scene.add(this.group);
    this.act = () => this.place();
    replay.onDraw.push(this.act);
  }

  _convex(name) {
    if (!this.parts.has(name)) this.parts.set(name, convexParts(this.bodies.get(name), this.replay.film.meshes));
    return this.parts.get(name);
  }

  _shells() {
    const { kind, b, flat, limit } = this.witness;
    if (kind !== "gap" || !limit) return [];
    const shells = [];
    for (const name of b) for (const part of this._convex(name)) {
      const shape = flat ? new THREE.LineLoop(new THREE.BufferGeometry(), new THREE.LineBasicMaterial()) : this._shell(part, limit);
      this.group.add(shape);
      shells.push({ name, part, shape });
    }
    return shells;
  }

  _shell(part, limit) {
    const both = new THREE.Group(), surface = shellOf(part, limit);
    [this.depth, this.glass].forEach((material, i) => {
      const mesh = new THREE.Mesh(surface, material);
      mesh.renderOrder = 1 + i;  // after the bodies, which would else be hidden
      both.add(mesh);
    });
    return both;
  }

  _placed(names, flat) {
    return names.flatMap((name) => {
      const pose = poseAt(this.replay.film, this.bodies.get(name), this.replay.time);
      return this._convex(name).map((part) => placed(part, pose, flat));
    });
  }

  place() {
    const { witness, replay } = this, thick = 0.003 * replay.eye.distance;
    const line = this._line();
    if (!line) return;
    const { from, to } = line, long = Math.hypot(...from.map((x, k) => x - to[k]));
    const bad = witness.kind === "gap" && witness.limit ? line.distance < witness.limit
      : this.finding.intervals.some(([a, b]) => a <= replay.time && replay.time < b);
    const idle = (witness.kind === "path" && long < 0.005) || witness.kind === "value";
    for (const mesh of [this.rod, ...this.ends]) mesh.visible = !idle;
    const colour = colourNow(bad ? "violation" : "accent");
    this.ink.color.setStyle(colourNow("mark-ink")); this.glass.color.setStyle(colour);
    stretch(this.rod, from, to, thick);
    this.ends.forEach((ball, i) => { ball.position.set(...(i ? to : from)); ball.scale.setScalar(2.2 * thick); });
    this._placeShells(colour);
    const said = this._said(long);
    this.label.textContent = bad ? `✕ ${said}` : said;
    this.label.classList.toggle("bad", bad);
    const over = from.map((x, k) => (x + to[k]) / 2 + (k === 2 ? 0.07 * replay.eye.distance : 0));
    replay.placeTag(this.label, said ? over : null);
  }

  /** {from, to, distance} of what is drawn now; null where there is nothing. */
  _line() {
    const { witness, replay } = this, at = (name, time) => poseAt(replay.film, this.bodies.get(name), time).slice(0, 3);
    if (witness.kind === "path") {
      const to = at(witness.body, Math.max(replay.time, witness.since));
      return { from: at(witness.body, witness.since), to };
    }
    if (witness.kind === "value") return { from: at(witness.body, replay.time), to: at(witness.body, replay.time) };
    const found = nearestOf(this._placed(witness.a, witness.flat), this._placed(witness.b, witness.flat));
    if (!found || !witness.flat) return found;
    const height = this._height(witness.b), lifted = (p) => [p[0], p[1], height];
    return { ...found, from: lifted(found.from), to: lifted(found.to) };
  }

  /** The words at the witness: what was measured, or else the length of what is drawn. */
  _said(long) {
    const measured = this._measured(this.finding.signal), { kind, name, a, b } = this.witness;
    if (kind === "touch") return this._touched(a, b);
    if (kind === "value") return measured === null ? "" : `${spoken(name)} ${measured}`;
    if (kind === "path" && long < 0.005) return "";
    return measured ?? `≈ ${amount(Math.round(1000 * long) / 10, "cm")}`;
  }

  /** Who touches whom, how hard, and how far that moves it: what of it was measured now. */
  _touched(a, b) {
    const who = (names) => (names.length > 2 ? "robot" : names.map(spoken).join(", "));
    const parts = this.finding.curves.map(({ signal }) => [TOUCHED[signal.split("(")[0]] ?? (signal === this.finding.signal ? spoken(this.witness.name) : null), this._measured(signal)])
      .filter(([word, measured]) => word !== null && measured !== null && Number.parseFloat(measured) !== 0).map(([word, measured]) => [measured, `${word} ${measured}`.trim()]);
    return parts.length ? `${who(a)} on ${who(b)}: ${[...new Map(parts.reverse()).values()].reverse().slice(0, 3).join(", ")}` : "";
  }

  /** What was measured now, where a measurement is known: it rests on every frame. */
  _measured(signal) {
    const curve = this.finding.curves.find((one) => one.signal === signal), { time } = this.replay;
    if (!curve) return null;
    const after = curve.t.findIndex((t) => t >= time - 1e-6), before = Math.max(after - 1, 0);
    if (after < 0 || curve.v[after] === null || curve.v[before] === null) return null;
    const wide = curve.t[after] - curve.t[before], near = 6e-4; // s: times of curves are whole milliseconds
    const share = wide && curve.t[after] - time > near ? Math.max(0, (time - curve.t[before]) / wide) : 1;
    return wide > 0.3 ? null : amount((1 - share) * curve.v[before] + share * curve.v[after], curve.unit);
  }

  _height(names) {
    return Math.min(...names.map((name) => poseAt(this.replay.film, this.bodies.get(name), this.replay.time)[2]));
  }

  _placeShells(colour) {
    const { film, time } = this.replay, { flat, limit, b } = this.witness;
    for (const { name, part, shape } of this.shells) {
      const pose = poseAt(film, this.bodies.get(name), time), [x, y, z, w, p, q, r] = pose;
      if (flat) {
        const corners = outlineOf(placed(part, pose, true), limit, this._height(b));
        shape.geometry.setAttribute("position", new THREE.BufferAttribute(corners, 3));
        shape.frustumCulled = false;
        shape.material.color.setStyle(colour);
      } else {
        shape.position.set(x, y, z); shape.quaternion.set(p, q, r, w).normalize();
      }
    }
  }

  dispose() {
    this.replay.onDraw = this.replay.onDraw.filter((act) => act !== this.act);
    this.replay.scene.remove(this.group);
    this.group.traverse((node) => { node.geometry?.dispose(); node.material?.dispose(); });
    this.label.remove();
  }
}
