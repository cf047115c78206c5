// SPDX-License-Identifier: BSD-3-Clause
// What lies under a pixel of the stage of a SceneView.
import {Matrix4} from 'three';

const MIN_REACH_PX = 8, MAX_REACH_PX = 40;

// The image whose camera is nearest, in multiples of its size, or null.
export function pickCamera(view, x, y) {
  const bodyPx = view.bodySize() * view.focalPx();
  let best = null, bestScore = 1;
  for (let image = 0; image < view.data.numImages; ++image) {
    const pose = view.poses.camera(image);
    const place = pose && view.project(pose.center);
    if (!place) continue;
    const distance = pose.center.distanceTo(view.camera.position);
    const reach = Math.min(Math.max(0.5 * bodyPx / distance, MIN_REACH_PX), MAX_REACH_PX);
    const score = Math.hypot(place.x - x, place.y - y) / reach;
    if (score >= bestScore) continue;
    best = image;
    bestScore = score;
  }
  return best;
}

// The nearest point, or null. Runs over millions of points, so it makes no
// objects.
export function pickPoint(view, x, y) {
  const p = view.points.geometry.attributes.position.array;
  view.camera.updateMatrixWorld();
  const m = new Matrix4().multiplyMatrices(
      view.camera.projectionMatrix, view.camera.matrixWorldInverse).elements;
  const {clientWidth: width, clientHeight: height} = view.stage;
  const ndcX = 2 * x / width - 1, ndcY = 1 - 2 * y / height;
  const reach = 5 + view.options.pointSize;
  let best = null, bestScore = reach * reach;
  for (let i = 0; i < p.length; i += 3) {
    const w = m[3] * p[i] + m[7] * p[i + 1] + m[11] * p[i + 2] + m[15];
    if (w <= view.camera.near) continue;
    const dx = (m[0] * p[i] + m[4] * p[i + 1] + m[8] * p[i + 2] + m[12]) / w - ndcX;
    const dy = (m[1] * p[i] + m[5] * p[i + 1] + m[9] * p[i + 2] + m[13]) / w - ndcY;
    const score = 0.25 * (dx * dx * width * width + dy * dy * height * height);
    if (score > bestScore) continue;
    best = i / 3;
    bestScore = score;
  }
  return best;
}
