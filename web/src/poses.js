// SPDX-License-Identifier: BSD-3-Clause
// Poses of frames and cameras in the coordinates of the 3D view, which are
// those of the page divided by `unit`.
import {Quaternion, Vector3} from 'three';
import {isRegistered} from './page_data.js';

export class Poses {
  constructor(data) {
    this.data = data;
    const size = new Vector3(...data.header.box_size);
    this.unit = 0.5 * size.length() || 1;
    this.sensors = data.header.sensors.map((sensor) => {
      const pose = sensor.sensor_from_rig;
      if (!pose) return null;
      const [w, x, y, z] = pose.rotation_wxyz;
      const rigFromSensor = new Quaternion(x, y, z, w).conjugate();
      const center = new Vector3(...pose.translation)
                         .applyQuaternion(rigFromSensor)
                         .multiplyScalar(-1 / this.unit);
      return {center, rigFromSensor};
    });
  }

  frameCenter(frame, center = new Vector3()) {
    return center.fromArray(this.data.arrays.frame_center, 3 * frame)
        .divideScalar(this.unit);
  }

  worldFromRig(frame, rotation = new Quaternion()) {
    const q = this.data.arrays.frame_world_from_rig;
    const i = 4 * frame;
    return rotation.set(q[i + 1], q[i + 2], q[i + 3], q[i]).normalize();
  }

  // {center, rotation} of a camera, or null.
  camera(image) {
    const frame = this.data.arrays.image_frame[image];
    const sensor = this.sensors[this.data.arrays.image_sensor[image]];
    if (!sensor || !isRegistered(this.data, frame)) return null;
    const worldFromRig = this.worldFromRig(frame);
    return {
      center: sensor.center.clone().applyQuaternion(worldFromRig)
                  .add(this.frameCenter(frame)),
      rotation: worldFromRig.multiply(sensor.rigFromSensor),
    };
  }

  point(index, position = new Vector3()) {
    return position.fromArray(this.data.pointPositions, 3 * index)
        .divideScalar(this.unit);
  }

  // The coordinates in the world of the model.
  toWorld(position) {
    return position.clone().multiplyScalar(this.unit)
        .add(new Vector3(...this.data.header.origin));
  }

  fromWorld(position) {
    return position.clone().sub(new Vector3(...this.data.header.origin))
        .divideScalar(this.unit);
  }

  // A position for every frame: for those that are not registered, between
  // their neighbors. NaN if there is none at all.
  pathPositions() {
    const {numFrames} = this.data;
    const positions = new Float32Array(3 * numFrames).fill(NaN);
    const known = [];
    const center = new Vector3();
    for (let i = 0; i < numFrames; ++i) {
      if (!isRegistered(this.data, i)) continue;
      this.frameCenter(i, center).toArray(positions, 3 * i);
      known.push(i);
    }
    let next = 0;
    for (let i = 0; i < numFrames && known.length > 0; ++i) {
      while (next < known.length && known[next] < i) ++next;
      if (known[next] === i) continue;
      const before = known[Math.max(next - 1, 0)];
      const after = known[Math.min(next, known.length - 1)];
      const share = after > before ? (i - before) / (after - before) : 0;
      for (let c = 0; c < 3; ++c) {
        positions[3 * i + c] = (1 - share) * positions[3 * before + c] +
            share * positions[3 * after + c];
      }
    }
    return positions;
  }

  // The median distance between consecutive registered frames.
  medianStep() {
    const steps = [];
    const a = new Vector3(), b = new Vector3();
    for (let i = 1; i < this.data.numFrames; ++i) {
      if (!isRegistered(this.data, i) || !isRegistered(this.data, i - 1)) {
        continue;
      }
      steps.push(this.frameCenter(i, a).distanceTo(this.frameCenter(i - 1, b)));
    }
    steps.sort((x, y) => x - y);
    return steps.length > 0 ? steps[steps.length >> 1] : 0;
  }
}
