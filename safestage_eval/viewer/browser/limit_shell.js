// A limit around bodies: the surface of all points so far from a shape, and the outline of it on the floor.

/** Geometry of a part blown up by `limit` m, in the body's frame: its support in every direction, moved out. */
export function shellOf(part, limit) {
  const ball = new THREE.IcosahedronGeometry(1, 7), at = ball.getAttribute("position");
  const normals = new Float32Array(at.count * 3);
  for (let i = 0; i < at.count; i++) {
    const d = [at.getX(i), at.getY(i), at.getZ(i)], core = part.core(d), out = part.radius + limit;
    at.setXYZ(i, core[0] + out * d[0], core[1] + out * d[1], core[2] + out * d[2]);
    normals.set(d, 3 * i);
  }
  ball.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  return ball;
}

/** Corners (world) of the outline of placed flat parts, each blown up by `limit`, at a height. */
export function outlineOf(part, limit, height) {
  const corners = [];
  for (let i = 0; i < 96; i++) {
    const d = [Math.cos(2 * Math.PI * i / 96), Math.sin(2 * Math.PI * i / 96), 0], core = part.core(d);
    corners.push(core[0] + (part.radius + limit) * d[0], core[1] + (part.radius + limit) * d[1], height);
  }
  return new Float32Array(corners);
}
