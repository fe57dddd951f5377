// Where the camera first stands: before an organ between two corners.
import { Vector3 } from 'three';

// Places the camera and returns what it looks at. A narrow picture shows the organ's width.
export function placed(camera, low_m, high_m) {
  const low = new Vector3(...low_m), high = new Vector3(...high_m), centre = low.clone().add(high).multiplyScalar(0.5), size = high.distanceTo(low);
  camera.position.copy(centre).add(new Vector3(-0.35, -1.35, 0.95).multiplyScalar(size * Math.max(1, 1.1 / camera.aspect)));
  camera.near = size / 100;
  camera.far = 20 * size;
  camera.updateProjectionMatrix();
  return centre;
}
