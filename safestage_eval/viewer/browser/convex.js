// Convex shapes by their supports, and where two of them are nearest (Gilbert, Johnson, Keerthi 1988).
// Every shape is a core with a radius around it; points are [x, y, z] in metres.

const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** A vector turned by the quaternion w x y z. */
export function turnedBy([w, x, y, z], v) {
  const t = scaled(cross([x, y, z], v), 2);
  return plus(plus(v, scaled(t, w)), cross([x, y, z], t));
}
const backBy = ([w, x, y, z], v) => turnedBy([w, -x, -y, -z], v);

const CORES = {
  sphere: () => [0, 0, 0],
  capsule: ([, half], d) => [0, 0, d[2] < 0 ? -half : half],
  box: (half, d) => half.map((h, k) => (d[k] < 0 ? -h : h)),
  cylinder: ([r, half], d) => {
    const across = Math.hypot(d[0], d[1]) || 1;
    return [r * d[0] / across, r * d[1] / across, d[2] < 0 ? -half : half];
  },
  ellipsoid: (radii, d) => {
    const long = Math.hypot(...d.map((x, k) => x * radii[k])) || 1;
    return d.map((x, k) => x * radii[k] ** 2 / long);
  },
};

function farthest(points, d) {
  let best = 0, most = -Infinity;
  for (let i = 0; i < points.length; i += 3) {
    const reach = points[i] * d[0] + points[i + 1] * d[1] + points[i + 2] * d[2];
    if (reach > most) { most = reach; best = i; }
  }
  return [points[best], points[best + 1], points[best + 2]];
}

/** The shapes of a body but planes: {core(direction), radius} in its frame. */
export function convexParts(body, meshes) {
  return body.geoms.filter((geom) => geom.kind !== "plane").map((geom) => {
    const points = geom.mesh === undefined ? null : meshes[geom.mesh].points;
    const local = (d) => (points ? farthest(points, d) : CORES[geom.kind](geom.size, d));
    const radius = geom.kind === "sphere" || geom.kind === "capsule" ? geom.size[0] : 0;
    const core = (d) => plus(geom.position, turnedBy(geom.orientation, local(backBy(geom.orientation, d))));
    return { core, radius };
  });
}

/** A part at a pose [x, y, z, w, x, y, z]; `flat`: its projection along z. */
export function placed(part, pose, flat = false) {
  const at = pose.slice(0, 3), turn = pose.slice(3);
  const core = (d) => {
    const point = plus(at, turnedBy(turn, part.core(backBy(turn, flat ? [d[0], d[1], 0] : d))));
    return flat ? [point[0], point[1], 0] : point;
  };
  return { core, radius: part.radius };
}

function solved(rows) {  // by elimination with pivots; null where they are dependent
  const n = rows.length, m = rows.map((row) => [...row]);
  for (let c = 0; c < n; c++) {
    let best = c;
    for (let r = c + 1; r < n; r++) if (Math.abs(m[r][c]) > Math.abs(m[best][c])) best = r;
    if (Math.abs(m[best][c]) < 1e-14) return null;
    [m[c], m[best]] = [m[best], m[c]];
    for (let r = 0; r < n; r++) {
      if (r === c) continue;
      const f = m[r][c] / m[c][c];
      for (let k = c; k <= n; k++) m[r][k] -= f * m[c][k];
    }
  }
  return m.map((row, i) => row[n] / row[i]);
}

/** Weights of the point of a simplex nearest to the origin: over all its faces, the best that lies inside. */
function weightsOf(simplex) {
  const n = simplex.length;
  let best = null;
  for (let mask = 1; mask < 1 << n; mask++) {
    const own = [...Array(n).keys()].filter((i) => mask & (1 << i)), base = simplex[own[0]].w;
    const edges = own.slice(1).map((i) => minus(simplex[i].w, base));
    const rows = edges.map((e) => [...edges.map((f) => dot(e, f)), -dot(e, base)]);
    const share = rows.length ? solved(rows) : [];
    if (!share) continue;
    const first = 1 - share.reduce((a, b) => a + b, 0);
    if ([first, ...share].some((x) => x < -1e-12)) continue;
    let v = base;
    share.forEach((s, k) => { v = plus(v, scaled(edges[k], s)); });
    if (!best || dot(v, v) < dot(best.v, best.v) - 1e-20) best = { v, own, weights: [first, ...share] };
  }
  return best;
}

/** {distance, from, to} of two placed shapes; the distance is 0 where they meet. */
export function nearest(a, b) {
  const at = (d) => {
    const pa = a.core(scaled(d, -1)), pb = b.core(d);
    return { a: pa, b: pb, w: minus(pa, pb) };
  };
  let simplex = [at([1, 0, 0])], found = weightsOf(simplex);
  for (let i = 0; i < 48; i++) {
    const { v } = found, square = dot(v, v);
    if (square < 1e-12) break;
    const next = at(v);
    if (square - dot(v, next.w) < 1e-6 * square + 1e-12) break;
    simplex = [...found.own.map((k) => simplex[k]), next];
    const better = weightsOf(simplex);
    if (!better || dot(better.v, better.v) >= square) { simplex.pop(); found.own = simplex.map((_, k) => k); break; }
    found = better;
  }
  let from = [0, 0, 0], to = [0, 0, 0];
  found.own.forEach((k, j) => {
    from = plus(from, scaled(simplex[k].a, found.weights[j]));
    to = plus(to, scaled(simplex[k].b, found.weights[j]));
  });
  const apart = Math.hypot(...found.v), way = apart > 1e-9 ? scaled(found.v, 1 / apart) : [0, 0, 0];
  const distance = Math.max(apart - a.radius - b.radius, 0);
  if (!distance) return { distance, from: to, to };
  return { distance, from: minus(from, scaled(way, a.radius)), to: plus(to, scaled(way, b.radius)) };
}

/** The nearest of several pairs. */
export function nearestOf(many, others) {
  let best = null;
  for (const a of many) for (const b of others) {
    const found = nearest(a, b);
    if (!best || found.distance < best.distance) best = found;
  }
  return best;
}
