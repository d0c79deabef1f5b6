/* SafestageReplay: draws a film of an episode (safestage_eval/replay/film.py says what is in it) on a
   canvas with WebGL 2. No library, no network. World frame, metres, z up; quaternions w x y z. The
   canvas's background colour is the sky.

     const replay = new SafestageReplay(canvas, arrayBuffer, {onTime, onState, tags});
     replay.play(); replay.pause(); replay.seek(3.2); replay.speed = 0.25; replay.look("top");
     replay.tint("cup", [r, g, b]); replay.project(replay.pose(body)); replay.dispose();

   tags: an element over the canvas, of the same size, for the names of the bodies that have a role.
   Keys on the focused canvas: arrows turn the view, + and - bring it nearer and farther, 0 resets it. */

const KIND = { robot: [0.86, 0.87, 0.89], gripper: [0.38, 0.4, 0.44], fixture: [0.74, 0.66, 0.55],
  object: [0.83, 0.72, 0.42], region: [0.3, 0.6, 0.9] };
const ROLE = { target: [0.22, 0.48, 0.86], dependent: [0.95, 0.55, 0.15], protected: [0.84, 0.25, 0.3],
  fragile: [0.84, 0.25, 0.3], destination: [0.3, 0.66, 0.36], support: [0.55, 0.5, 0.75],
  container: [0.3, 0.62, 0.62] };
const FLOOR = [0.5, 0.52, 0.55];
const LOOKS = { front: [0, 0], side: [-0.9, 0.2], back: [2.4, 0], top: [0.35, -0.97] };
const SUN = [0.28, -0.32, 0.9];  // towards the light

const VERTEX = `#version 300 es
  in vec3 point; in vec3 normal; uniform mat4 view, sun; uniform mat3 turn; uniform vec3 shift;
  out vec3 n, w; out vec4 s;
  void main() { w = turn * point + shift; n = turn * normal; s = sun * vec4(w, 1.0);
    gl_Position = view * vec4(w, 1.0); }`;
const FRAGMENT = `#version 300 es
  precision highp float; precision highp sampler2DShadow;
  in vec3 n, w; in vec4 s; uniform vec3 eye, light; uniform vec4 colour; uniform sampler2DShadow shade;
  out vec4 pixel;
  void main() {
    vec3 m = normalize(n), to = normalize(eye - w);
    float sun = max(dot(m, light), 0.0), lit = 1.0;
    vec3 p = s.xyz * 0.5 + 0.5;
    if (sun > 0.0 && all(greaterThan(p, vec3(0.0))) && all(lessThan(p, vec3(1.0))))
      lit = texture(shade, p - vec3(0.0, 0.0, 0.0025));
    float glow = 0.42 + 0.2 * max(dot(m, to), 0.0) + 0.5 * sun * lit;
    pixel = vec4(colour.rgb * glow * colour.a, colour.a); }`;
const NOTHING = `#version 300 es
  precision lowp float; void main() {}`;

function shader(gl, fragment) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, fragment]]) {
    const part = gl.createShader(kind);
    gl.shaderSource(part, text); gl.compileShader(part); gl.attachShader(program, part);
  }
  gl.bindAttribLocation(program, 0, "point"); gl.bindAttribLocation(program, 1, "normal");
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
    throw new Error(gl.getProgramInfoLog(program));
  const names = ["view", "sun", "turn", "shift", "eye", "light", "colour", "shade"];
  const at = Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)]));
  return { program, at };
}

const TOOLS = new WeakMap();  // graphics context -> shaders and shadow map, for all its replays

function tools(gl) {
  if (TOOLS.has(gl)) return TOOLS.get(gl);
  const made = { light: shader(gl, FRAGMENT), depth: shader(gl, NOTHING), shade: gl.createTexture(), dark: gl.createFramebuffer() };
  gl.bindTexture(gl.TEXTURE_2D, made.shade);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, 1024, 1024);
  const set = (name, value) => gl.texParameteri(gl.TEXTURE_2D, name, value);
  set(gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
  set(gl.TEXTURE_MIN_FILTER, gl.LINEAR); set(gl.TEXTURE_MAG_FILTER, gl.LINEAR);
  set(gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE); set(gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  gl.bindFramebuffer(gl.FRAMEBUFFER, made.dark);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, made.shade, 0);
  gl.enable(gl.DEPTH_TEST); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  TOOLS.set(gl, made);
  return made;
}

let processor = null;

/** Whether there is no graphics card to draw: then fewer pixels have to do. */
function drawnByProcessor() {
  if (processor !== null) return processor;
  const gl = document.createElement("canvas").getContext("webgl2");
  const name = gl?.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL;
  const known = name ? gl.getParameter(name) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  processor = /swiftshader|llvmpipe|software/i.test(known);
  return processor;
}

globalThis.SafestageReplay = class SafestageReplay {
  /** Raises Error where the browser has no WebGL 2. */
  constructor(canvas, buffer, { onTime = () => {}, onState = () => {}, tags = null } = {}) {
    this.canvas = canvas; this.film = read(buffer); this.onTime = onTime; this.onState = onState;
    this.start = this.film.times[0]; this.end = this.film.times.at(-1);
    this.time = this.start; this.speed = 1; this.playing = false; this.tints = {};
    this.fine = drawnByProcessor() ? 0.75 : Math.min(devicePixelRatio, 2);  // pixels per CSS pixel
    this.gl = canvas.getContext("webgl2", { antialias: this.fine >= 1 });
    if (!this.gl) throw new Error("this browser draws no 3-D pictures (WebGL 2 is off)");
    this.off = new AbortController();
    this.tags = tags ? this.film.bodies.filter((body) => body.roles.length).map((body) => this._tag(body, tags)) : [];
    this._prepare(); this._listen(); this.look("front");
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

  /** Another colour for a body, [r, g, b] of 0 … 1; null gives it its own again. */
  tint(name, colour) { this.tints[name] = colour; this.draw(); }

  /** The colour of what plays a role. */
  static roleColour(role) { return ROLE[role] ?? KIND.object; }

  colour(body) {
    const role = body.roles.find((name) => ROLE[name]);
    if (this.tints?.[body.name]) return this.tints[body.name];
    if (role) return ROLE[role];
    return body.geoms.every((geom) => geom.kind === "plane") ? FLOOR : KIND[body.kind];
  }

  dispose() {
    this.pause(); this.off.abort(); this.resize.disconnect();
    for (const { element } of this.tags) element.remove();
    const gl = this.gl;
    for (const { array, buffer } of this.parts) { gl.deleteVertexArray(array); gl.deleteBuffer(buffer); }
  }

  _listen() {
    const { canvas } = this, held = new Map();  // pointers that are down, and where
    const on = (name, act, more = {}) => canvas.addEventListener(name, act, { signal: this.off.signal, ...more });
    const apart = () => {
      const [a, b] = [...held.values()];
      return Math.hypot(a[0] - b[0], a[1] - b[1]);
    };
    on("pointerdown", (e) => {
      held.set(e.pointerId, [e.clientX, e.clientY]);
      canvas.setPointerCapture(e.pointerId);
    });
    for (const name of ["pointerup", "pointercancel"]) on(name, (e) => held.delete(e.pointerId));
    on("pointermove", (e) => {
      const before = held.get(e.pointerId);
      if (!before) return;
      const was = held.size === 2 ? apart() : 0;
      held.set(e.pointerId, [e.clientX, e.clientY]);
      if (was) this.zoom(was / Math.max(apart(), 1));
      else if (e.shiftKey) this._pan(e.clientX - before[0], e.clientY - before[1]);
      else this.orbit((before[0] - e.clientX) / 150, (before[1] - e.clientY) / 200);
    });
    on("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(e.deltaY / 800)); }, { passive: false });
    on("keydown", (e) => {
      const act = {
        ArrowLeft: () => this.orbit(-0.1, 0), ArrowRight: () => this.orbit(0.1, 0),
        ArrowUp: () => this.orbit(0, -0.1), ArrowDown: () => this.orbit(0, 0.1),
        "+": () => this.zoom(0.9), "=": () => this.zoom(0.9), "-": () => this.zoom(1.1), 0: () => this.look("front"),
      }[e.key];
      if (act && !e.ctrlKey && !e.metaKey && !e.altKey) { act(); e.preventDefault(); e.stopPropagation(); }
    });
    on("webglcontextlost", (e) => e.preventDefault());
    on("webglcontextrestored", () => { TOOLS.delete(this.gl); this._prepare(); this.draw(); });
  }

  _pan(dx, dy) {
    const { azimuth, distance, at } = this.eye, scale = distance / this.canvas.clientHeight;
    at[0] -= Math.sin(azimuth) * dx * scale; at[1] += Math.cos(azimuth) * dx * scale; at[2] += dy * scale;
    this.draw();
  }

  // ---- the picture

  _prepare() {
    const { gl } = this;
    Object.assign(this, tools(gl));
    this.parts = this.film.bodies.map((body) => {
      const corners = surface(body, this.film.meshes), array = gl.createVertexArray(), buffer = gl.createBuffer();
      gl.bindVertexArray(array); gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, corners, gl.STATIC_DRAW);
      for (const slot of [0, 1]) {
        gl.enableVertexAttribArray(slot);
        gl.vertexAttribPointer(slot, 3, gl.FLOAT, false, 24, 12 * slot);
      }
      return { body, array, buffer, count: corners.length / 6 };
    });
    this.parts.sort((a, b) => (a.body.kind === "region") - (b.body.kind === "region"));  // what one sees through comes last
  }

  /** [x, y, z, w, x, y, z] of a body now, between the poses on either side. */
  pose(body) {
    if (body.pose) return body.pose;
    const { times } = this.film;
    let low = 0, high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= this.time) low = middle; else high = middle;
    }
    const share = Math.min(Math.max((this.time - times[low]) / (times[high] - times[low] || 1), 0), 1);
    return Array.from({ length: 7 }, (_, k) => (1 - share) * body.poses[7 * low + k] + share * body.poses[7 * high + k]);
  }

  /** Where a world point is on the canvas, in CSS pixels, after the last draw; null behind the eye. */
  project(point) {
    const v = this.view, { clientWidth, clientHeight } = this.canvas;
    const [x, y, w] = [0, 1, 3].map((r) => v[r] * point[0] + v[4 + r] * point[1] + v[8 + r] * point[2] + v[12 + r]);
    return w <= 0 ? null : [(x / w + 1) / 2 * clientWidth, (1 - y / w) / 2 * clientHeight];
  }

  _tag(body, layer) {
    const element = document.createElement("span");
    element.textContent = `${body.name.replaceAll("_", " ")} (${body.roles.join(", ")})`;
    layer.append(element);
    return { body, element };
  }

  _placeTags() {
    for (const { body, element } of this.tags) {
      const at = this.project(this.pose(body));
      const inside = at && at[0] > 0 && at[1] > 0 && at[0] < this.canvas.clientWidth && at[1] < this.canvas.clientHeight;
      element.hidden = !inside;
      if (inside) element.style.transform = `translate(-50%, -50%) translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px)`;
    }
  }

  draw() {
    const { gl, canvas, eye, fine } = this;
    const width = Math.round(canvas.clientWidth * fine), height = Math.round(canvas.clientHeight * fine);
    if (!width || !height || !eye || gl.isContextLost()) return;
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    const flatly = Math.cos(eye.elevation);
    const forward = [flatly * Math.cos(eye.azimuth), flatly * Math.sin(eye.azimuth), Math.sin(eye.elevation)];
    const from = eye.at.map((x, k) => x - eye.distance * forward[k]);
    this.view = times(perspective(width / height, 0.02, 30), seen(from, forward, [0, 0, 1]));
    const half = 1.3, ray = unit(SUN), lamp = this.film.look.at.map((x, k) => x + 3 * ray[k]);
    const flat = [1 / half, 0, 0, 0, 0, 1 / half, 0, 0, 0, 0, -1 / 3, 0, 0, 0, -1, 1];
    const sun = times(flat, seen(lamp, ray.map((x) => -x), [0, 1, 0]));
    const poses = this.parts.map((part) => this.pose(part.body));
    const back = getComputedStyle(canvas).backgroundColor.match(/[\d.]+/g).map((x) => x / 255);
    const passes = [[this.depth, this.dark, 1024, 1024, sun], [this.light, null, width, height, this.view]];
    for (const [kind, target, w, h, view] of passes) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, target); gl.viewport(0, 0, w, h);
      gl.clearColor(back[0], back[1], back[2], 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.useProgram(kind.program); gl.bindTexture(gl.TEXTURE_2D, target ? null : this.shade);
      gl.uniformMatrix4fv(kind.at.view, false, view); gl.uniformMatrix4fv(kind.at.sun, false, sun);
      gl.uniform3fv(kind.at.eye, from); gl.uniform3fv(kind.at.light, ray); gl.uniform1i(kind.at.shade, 0);
      this.parts.forEach((part, i) => {
        const glass = part.body.kind === "region";
        if (!part.count || (glass && target)) return;
        if (glass) gl.enable(gl.BLEND); else gl.disable(gl.BLEND);
        gl.uniform4f(kind.at.colour, ...this.colour(part.body), glass ? 0.3 : 1);
        gl.uniform3fv(kind.at.shift, poses[i].slice(0, 3));
        gl.uniformMatrix3fv(kind.at.turn, false, matrix(poses[i].slice(3)));
        gl.bindVertexArray(part.array); gl.drawArrays(gl.TRIANGLES, 0, part.count);
      });
    }
    this._placeTags();
  }
};
