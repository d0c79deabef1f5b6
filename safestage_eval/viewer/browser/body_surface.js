// Surfaces of bodies for three.js: one geometry per body, in its frame, and one that is blown up to outline it.

const HALF_FLOOR = 3; // m, what is drawn of a plane

const SOLIDS = {
  sphere: ([r]) => new THREE.SphereGeometry(r, 28, 18),
  ellipsoid: (radii) => new THREE.SphereGeometry(1, 28, 18).scale(...radii),
  box: (half) => new THREE.BoxGeometry(...half.map((h) => 2 * h)),
  cylinder: ([r, h]) => new THREE.CylinderGeometry(r, r, 2 * h, 32).rotateX(Math.PI / 2),
  capsule: ([r, h]) => new THREE.CapsuleGeometry(r, 2 * h, 10, 24).rotateX(Math.PI / 2),
  plane: () => new THREE.PlaneGeometry(2 * HALF_FLOOR, 2 * HALF_FLOOR),
};

function triangulated(mesh) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(mesh.points, 3));
  geometry.setIndex(new THREE.BufferAttribute(mesh.faces, 1));
  const flat = geometry.toNonIndexed();
  flat.computeVertexNormals();
  return flat;
}

/** The geometry of all shapes of a body; null if it has none. */
export function surfaceOf(body, meshes) {
  const parts = body.geoms.map((geom) => {
    const made = geom.mesh === undefined ? SOLIDS[geom.kind](geom.size) : triangulated(meshes[geom.mesh]);
    const own = made.index ? made.toNonIndexed() : made, [w, x, y, z] = geom.orientation;
    const pose = new THREE.Matrix4().compose(
      new THREE.Vector3(...geom.position), new THREE.Quaternion(x, y, z, w).normalize(), new THREE.Vector3(1, 1, 1));
    return own.applyMatrix4(pose);
  });
  if (!parts.length) return null;
  const joined = new THREE.BufferGeometry();
  for (const name of ["position", "normal"]) {
    const all = parts.map((part) => part.getAttribute(name).array);
    const array = new Float32Array(all.reduce((sum, one) => sum + one.length, 0));
    let at = 0;
    for (const one of all) { array.set(one, at); at += one.length; }
    joined.setAttribute(name, new THREE.BufferAttribute(array, 3));
  }
  return joined;
}

/** The same surface with one normal at each corner, so that it does not tear when it is blown up. */
export function unbroken(surface) {
  const places = surface.getAttribute("position").array, normals = surface.getAttribute("normal").array;
  const sums = new Map(), keys = [];
  for (let i = 0; i < places.length; i += 3) {
    const key = [0, 1, 2].map((k) => Math.round(places[i + k] * 1e5)).join();
    const sum = sums.get(key) ?? [0, 0, 0];
    for (let k = 0; k < 3; k++) sum[k] += normals[i + k];
    sums.set(key, sum); keys.push(key);
  }
  const array = new Float32Array(places.length);
  keys.forEach((key, i) => {
    const sum = sums.get(key), long = Math.hypot(...sum) || 1;
    for (let k = 0; k < 3; k++) array[3 * i + k] = sum[k] / long;
  });
  const out = new THREE.BufferGeometry();
  out.setAttribute("position", surface.getAttribute("position"));
  out.setAttribute("normal", new THREE.BufferAttribute(array, 3));
  return out;
}
