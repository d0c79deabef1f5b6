// What the player uses of three; everything else is left out of three.min.js.
export {
  BackSide, BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, CylinderGeometry,
  DirectionalLight, DoubleSide, Group, HemisphereLight, IcosahedronGeometry, Line,
  LineBasicMaterial, LineLoop, LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial,
  PCFShadowMap, PerspectiveCamera, PlaneGeometry, Points, PointsMaterial, Quaternion, Scene, ShaderMaterial,
  SphereGeometry, Vector3, WebGLRenderer,
} from "three";
