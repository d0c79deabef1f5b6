/* Algebra, surfaces of shapes, and reading a film: what replay.js draws with. */

const HALF_FLOOR = 3; // m, what is drawn of a plane

// ---- a little algebra: matrices are columns, as WebGL has them

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((x) => x / n); };
const turned = (m, p) => [0, 1, 2].map((i) => m[i] * p[0] + m[3 + i] * p[1] + m[6 + i] * p[2]);

function matrix(q) {
  const [w, x, y, z] = unit(q);
  return [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w),
    2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w),
    2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)];
}

function times(a, b) {
  const out = new Array(16).fill(0);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++)
    for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
}

function seen(eye, forward, up) {
  const right = unit(cross(forward, up)), top = cross(right, forward);
  return [right[0], top[0], -forward[0], 0, right[1], top[1], -forward[1], 0,
    right[2], top[2], -forward[2], 0, -dot(right, eye), -dot(top, eye), dot(forward, eye), 1];
}

function perspective(wide, near, far) {
  const f = 1 / Math.tan(0.36);  // 41 degrees high, or wide where the canvas is upright
  const narrow = Math.min(1, wide);
  return [f * narrow / wide, 0, 0, 0, 0, f * narrow, 0, 0, 0, 0, (near + far) / (near - far), -1,
    0, 0, 2 * near * far / (near - far), 0];
}

// ---- surfaces: flat lists of corner, normal, corner, normal … in the geom frame

function patch(out, rows, columns, at) {  // at(u, v) -> [corner, normal]
  for (let i = 0; i < rows; i++) for (let j = 0; j < columns; j++) {
    const [a, b, c, d] = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(([u, v]) => at(u / rows, v / columns));
    for (const corner of [a, b, c, a, c, d]) out.push(...corner[0], ...corner[1]);
  }
}

function ellipsoid(out, radii, from = 0, to = 1, lift = 0) {
  patch(out, Math.ceil(12 * (to - from)), 24, (u, v) => {
    const polar = Math.PI * (from + (to - from) * u), around = 2 * Math.PI * v;
    const n = [Math.sin(polar) * Math.cos(around), Math.sin(polar) * Math.sin(around), Math.cos(polar)];
    return [[n[0] * radii[0], n[1] * radii[1], n[2] * radii[2] + lift], unit(n.map((x, k) => x / radii[k]))];
  });
}

const MAKE = {
  sphere: (out, [r]) => ellipsoid(out, [r, r, r]),
  ellipsoid: (out, radii) => ellipsoid(out, radii),
  box: (out, half) => {
    for (let axis = 0; axis < 3; axis++) for (const side of [-1, 1]) {
      const normal = [0, 0, 0]; normal[axis] = side;
      patch(out, 1, 1, (u, v) => {
        const corner = [0, 0, 0];
        corner[axis] = side * half[axis];
        corner[(axis + 1) % 3] = side * (2 * u - 1) * half[(axis + 1) % 3];
        corner[(axis + 2) % 3] = (2 * v - 1) * half[(axis + 2) % 3];
        return [corner, normal];
      });
    }
  },
  cylinder: (out, [r, h]) => {
    tube(out, r, h);
    for (const side of [-1, 1]) patch(out, 1, 32, (u, v) => {
      const a = 2 * Math.PI * v * side;
      return [[r * u * Math.cos(a), r * u * Math.sin(a), side * h], [0, 0, side]];
    });
  },
  capsule: (out, [r, h]) => { tube(out, r, h); ellipsoid(out, [r, r, r], 0, 0.5, h); ellipsoid(out, [r, r, r], 0.5, 1, -h); },
  plane: (out) => patch(out, 1, 1, (u, v) => [[(2 * u - 1) * HALF_FLOOR, (2 * v - 1) * HALF_FLOOR, 0], [0, 0, 1]]),
};

function tube(out, r, h) {
  patch(out, 1, 32, (u, v) => {
    const n = [Math.cos(2 * Math.PI * v), Math.sin(2 * Math.PI * v), 0];
    return [[n[0] * r, n[1] * r, h * (1 - 2 * u)], n];
  });
}

function triangles(out, mesh) {
  for (const face of mesh.faces) {
    const [a, b, c] = face.map((i) => mesh.points[i]), n = unit(cross(minus(b, a), minus(c, a)));
    out.push(...a, ...n, ...b, ...n, ...c, ...n);
  }
}

function surface(body, meshes) {  // of all geoms, in the body frame
  const out = [];
  for (const geom of body.geoms) {
    const own = [], turn = matrix(geom.orientation);
    if (geom.mesh === undefined) MAKE[geom.kind](own, geom.size);
    else triangles(own, meshes[geom.mesh]);
    for (let i = 0; i < own.length; i += 6) {
      const p = turned(turn, own.slice(i, i + 3)), n = turned(turn, own.slice(i + 3, i + 6));
      out.push(p[0] + geom.position[0], p[1] + geom.position[1], p[2] + geom.position[2], ...n);
    }
  }
  return new Float32Array(out);
}

// ---- the file

function read(buffer) {
  const length = new DataView(buffer).getUint32(0, true), start = 4 + length;
  const film = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const N = film.frames;
  film.times = new Float32Array(buffer, start + film.times, N);
  film.meshes = film.meshes.map((mesh) => {
    const v = new Uint16Array(buffer, start + mesh.vertices, 3 * mesh.points);
    const f = new Uint32Array(buffer, start + mesh.triangles, 3 * mesh.faces);
    const three = (list, count, of) =>
      Array.from({ length: count }, (_, i) => [0, 1, 2].map((k) => of(list[3 * i + k], k)));
    const points = three(v, mesh.points, (n, k) => mesh.low[k] + mesh.step * n);
    return { points, faces: three(f, mesh.faces, (n) => n) };
  });
  for (const body of film.bodies) {
    if (body.pose) continue;
    const steps = new Uint16Array(buffer, start + body.track, 7 * N), poses = new Float32Array(7 * N);
    for (let column = 0; column < 7; column++) for (let i = 0, sum = 0; i < N; i++) {
      sum = (sum + steps[column * N + i]) & 65535;
      const signed = sum > 32767 ? sum - 65536 : sum;
      poses[7 * i + column] = column < 3 ? body.low[column] + body.step * sum : signed / 32767;
    }
    body.poses = poses;
  }
  return film;
}
