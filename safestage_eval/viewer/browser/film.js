// Reading a film of an episode: safestage_eval/viewer/film.py says what is in it.

function meshOf(buffer, start, mesh) {
  const steps = new Uint16Array(buffer, start + mesh.vertices, 3 * mesh.points);
  const faces = new Uint32Array(buffer, start + mesh.triangles, 3 * mesh.faces);
  const points = new Float32Array(steps.length);
  for (let i = 0; i < steps.length; i++) points[i] = mesh.low[i % 3] + mesh.step * steps[i];
  return { points, faces };
}

/** The JSON head of a file, and where the numbers start. */
export function headOf(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { head, start: 4 + length };
}

/** A mesh that lies in a piece of its own: {points (3 V), faces (3 F)}. */
export function sharedMesh(buffer) {
  const { head, start } = headOf(buffer);
  return meshOf(buffer, start, head);
}

/** A film with its arrays; `shared` is a map from keys to meshes that lie elsewhere. */
export function filmOf(buffer, shared = new Map()) {
  const { head: film, start } = headOf(buffer), N = film.frames;
  film.times = new Float32Array(buffer, start + film.times, N);
  film.meshes = film.meshes.map((mesh) =>
    mesh.key === undefined ? meshOf(buffer, start, mesh) : shared.get(mesh.key));
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

/** [x, y, z, w, x, y, z] of a body at a time, between the poses on either side. */
export function poseAt(film, body, time) {
  if (body.pose) return body.pose;
  const { times } = film;
  let low = 0, high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle; else high = middle;
  }
  const share = Math.min(Math.max((time - times[low]) / (times[high] - times[low] || 1), 0), 1);
  return Array.from({ length: 7 }, (_, k) => (1 - share) * body.poses[7 * low + k] + share * body.poses[7 * high + k]);
}
