// A canvas with its renderer, lights and shadows; one for all the replays that it shows, one after the other.

const STAGES = new WeakMap();

let processor = null;

/** Whether there is no graphics card to draw: then fewer pixels have to do. */
export function drawnByProcessor() {
  if (processor !== null) return processor;
  const gl = document.createElement("canvas").getContext("webgl2");
  const name = gl?.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL;
  const known = name ? gl.getParameter(name) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  processor = /swiftshader|llvmpipe|software/i.test(known);
  return processor;
}

/** The stage of a canvas. Raises Error where the browser has no WebGL 2. */
export function stageOf(canvas) {
  if (STAGES.has(canvas)) return STAGES.get(canvas);
  const slow = drawnByProcessor(), fine = slow ? 0.75 : Math.min(devicePixelRatio, 2);
  const context = canvas.getContext("webgl2", { antialias: fine >= 1, alpha: true });
  if (!context) throw new Error("this browser draws no 3-D pictures (WebGL 2 is off)");
  const renderer = new THREE.WebGLRenderer({ canvas, context });
  renderer.setPixelRatio(fine);
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = THREE.PCFShadowMap;
  const stage = { renderer, fine };
  STAGES.set(canvas, stage);
  return stage;
}

/** Light a scene around a point (m, world). */
export function lit(scene, [x, y, z]) {
  const sun = new THREE.DirectionalLight(0xffffff, 1.9);
  sun.position.set(x + 0.84, y - 0.96, z + 2.7);
  sun.target.position.set(x, y, z);
  sun.castShadow = true;
  sun.shadow.mapSize.set(1024, 1024);
  sun.shadow.bias = -0.0008;
  sun.shadow.normalBias = 0.004;
  Object.assign(sun.shadow.camera, { left: -1.3, right: 1.3, top: 1.3, bottom: -1.3, near: 0.3, far: 6 });
  const sky = new THREE.HemisphereLight(0xffffff, 0x8d8b86, 1.75);
  sky.position.set(0, 0, 1);
  scene.add(sun, sun.target, sky);
}
