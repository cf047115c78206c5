// SPDX-License-Identifier: BSD-3-Clause
// Photos in the bodies of cameras: those of the current frame, and of cameras
// that are near enough to recognize something.
import {Vector3} from 'three';
import {makePhoto} from './drawables.js';

const MIN_BODY_PX = 40, MAX_PHOTOS = 32;
// Of the bodies of the current frame.
export const SCALE_OF_CURRENT = 1.3;

export class BodyPhotos {
  constructor(view) {
    this.view = view;
    this.shown = new Map();  // image to {mesh, size}
  }

  // The images to show, with the sizes of their bodies.
  choose() {
    const {view} = this;
    const {thumbnails, imagesOfFrame} = view.data;
    const current = imagesOfFrame[view.currentFrame] ?? [];
    const maxDistance = view.bodySize() * view.focalPx() / MIN_BODY_PX;
    const chosen = new Map();
    for (const image of [...current, ...view.chooseCameras()]) {
      const pose = view.poses.camera(image);
      if (!pose || !thumbnails.has(image) || chosen.has(image)) continue;
      const isCurrent = current.includes(image);
      if (!isCurrent && pose.center.distanceTo(view.camera.position) > maxDistance) continue;
      chosen.set(image, view.bodySize() * (isCurrent ? SCALE_OF_CURRENT : 1));
      if (chosen.size === MAX_PHOTOS) break;
    }
    return chosen;
  }

  update() {
    const chosen = this.choose();
    for (const [image, {mesh, size}] of this.shown) {
      if (chosen.get(image) === size) continue;
      this.view.disposeObject(mesh);
      this.shown.delete(image);
    }
    for (const [image, size] of chosen) {
      if (!this.shown.has(image)) this.shown.set(image, {mesh: this.make(image, size), size});
    }
  }

  make(image, size) {
    const {header, arrays, thumbnails} = this.view.data;
    const {center, rotation} = this.view.poses.camera(image);
    const [x, y, right, lower] = header.sensors[arrays.image_sensor[image]].view_tangents;
    // Slightly before the edges, which stay visible.
    const depth = 0.99 * size / Math.hypot(1, x, y);
    const corners = [[-x, -y], [right, -y], [-x, lower], [right, lower]].map(
        (corner) => new Vector3(...corner, 1).multiplyScalar(depth)
                        .applyQuaternion(rotation).add(center));
    const photo = makePhoto(corners, thumbnails.get(image), () => this.view.requestRender());
    this.view.scene.add(photo);
    return photo;
  }

  setVisible(isVisible) {
    for (const {mesh} of this.shown.values()) {
      mesh.visible = isVisible && mesh.material.uniforms.map.value !== null;
    }
  }
}
