// How roles are shown in 3-D: an outline, and a hatching of the surface, both in ink and without a colour.

const PATTERNS = ["plain", "rising", "falling", "cross", "level", "dots"];

const HATCH = `
  float band(float x) { return smoothstep(0.34, 0.46, abs(fract(x) - 0.5)); }
  float hatching(vec2 p, int kind) {
    p /= 9.0;
    float a = band(p.x + p.y), b = band(p.x - p.y);
    if (kind == 1) return b;
    if (kind == 2) return a;
    if (kind == 3) return max(a, b);
    if (kind == 4) return band(p.y);
    if (kind == 5) return 1.0 - smoothstep(0.16, 0.26, length(fract(p) - 0.5));
    return 0.0;
  }`;

/** Have a material hatch what it draws; `ink` is a THREE.Color in the material's userData. */
export function hatch(material, pattern, ink, fine) {
  const kind = Math.max(PATTERNS.indexOf(pattern), 0);
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, { hatchKind: { value: kind }, hatchInk: { value: ink }, hatchFine: { value: fine } });
    shader.fragmentShader = `uniform int hatchKind; uniform vec3 hatchInk; uniform float hatchFine; ${HATCH}
      ${shader.fragmentShader}`.replace("#include <opaque_fragment>", `#include <opaque_fragment>
      gl_FragColor.rgb = mix(gl_FragColor.rgb, hatchInk, 0.62 * hatching(gl_FragCoord.xy / hatchFine, hatchKind));`);
  };
  material.customProgramCacheKey = () => "hatched";
}

/** A material that draws the far side of a blown-up surface: an outline of even width on the screen. */
export function outlining(ink) {
  return new THREE.ShaderMaterial({
    side: THREE.BackSide,
    uniforms: { ink: { value: ink } },
    vertexShader: `void main() {
      vec4 at = modelViewMatrix * vec4(position, 1.0);
      at.xyz += normalize(normalMatrix * normal) * (-at.z) * 0.0055;
      gl_Position = projectionMatrix * at; }`,
    fragmentShader: `uniform vec3 ink; void main() { gl_FragColor = vec4(ink, 1.0);
      #include <colorspace_fragment>
    }`,
  });
}

/** Class of a swatch for a role in a legend; `hatchings` maps roles to patterns. */
export const swatchOf = (role, hatchings) => `swatch hatch-${hatchings[role] ?? "plain"}`;
