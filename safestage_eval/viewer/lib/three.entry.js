// What the player uses of three; everything else is left out of three.min.js.
export {
  BackSide, BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color,
  CylinderGeometry,
  DirectionalLight, DoubleSide, Group, HemisphereLight, IcosahedronGeometry,
  LineBasicMaterial, LineLoop, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial,
  PCFShadowMap, PerspectiveCamera, PlaneGeometry, Quaternion, Scene, ShaderMaterial,
  SphereGeometry, Vector3, WebGLRenderer,
} from "three";
