// SPDX-License-Identifier: BSD-3-Clause
// The objects of the 3D view.
import {BufferAttribute, BufferGeometry, InstancedBufferAttribute,
        InstancedBufferGeometry, LineBasicMaterial, LineSegments, Points,
        ShaderMaterial} from 'three';

const POINT_VERTEX = `
attribute vec3 tint;
uniform float size;
varying vec3 vTint;
void main() {
  vTint = tint;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  gl_PointSize = size;
}`;

const FLAT_FRAGMENT = `
varying vec3 vTint;
void main() { gl_FragColor = vec4(vTint, 1.0); }`;

// Points with a color each, of a size in pixels.
export function makePoints(positions, size) {
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(positions, 3));
  geometry.setAttribute(
      'tint', new BufferAttribute(new Uint8Array(positions.length), 3, true));
  const material = new ShaderMaterial({
    uniforms: {size: {value: size}},
    vertexShader: POINT_VERTEX,
    fragmentShader: FLAT_FRAGMENT,
  });
  const points = new Points(geometry, material);
  points.frustumCulled = false;
  return points;
}

export function setPointColors(points, colorOf) {
  const tint = points.geometry.attributes.tint;
  for (let i = 0; i < tint.count; ++i) {
    const [r, g, b] = colorOf(i);
    tint.array[3 * i] = 255 * r;
    tint.array[3 * i + 1] = 255 * g;
    tint.array[3 * i + 2] = 255 * b;
  }
  tint.needsUpdate = true;
}

// A camera: the edges of its pyramid, a mark at the upper edge, and a line to
// the center of its rig, which joins the cameras of a frame into one body.
const CAMERA_LINES = [
  [0, 0, 0], [-1, -1, 1], [0, 0, 0], [1, -1, 1], [0, 0, 0], [1, 1, 1],
  [0, 0, 0], [-1, 1, 1], [-1, -1, 1], [1, -1, 1], [1, -1, 1], [1, 1, 1],
  [1, 1, 1], [-1, 1, 1], [-1, 1, 1], [-1, -1, 1], [-0.4, -1, 1],
  [0, -1.35, 1], [0, -1.35, 1], [0.4, -1, 1], [0, 0, 0], [0, 0, -1],
];

// z = -1 stands for the center of the rig.
const CAMERA_VERTEX = `
attribute vec3 center;
attribute vec4 rotation;
attribute vec3 rigCenter;
attribute vec2 tangents;
attribute vec3 tint;
uniform float size;
varying vec3 vTint;
void main() {
  vTint = tint;
  // Wide fields of view are drawn with edges of the same length.
  vec3 corner = size * vec3(position.xy * tangents, position.z) /
      sqrt(1.0 + dot(tangents, tangents));
  vec3 turned = corner + 2.0 * cross(rotation.xyz,
      cross(rotation.xyz, corner) + rotation.w * corner);
  vec3 world = position.z < -0.5 ? rigCenter : center + turned;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(world, 1.0);
}`;

const CAMERA_ATTRIBUTES = {
  center: 3, rotation: 4, rigCenter: 3, tangents: 2, tint: 3,
};

// Up to `capacity` cameras, drawn in one call.
export class CameraBodies {
  constructor(capacity, size) {
    const geometry = new InstancedBufferGeometry();
    geometry.setAttribute(
        'position',
        new BufferAttribute(Float32Array.from(CAMERA_LINES.flat()), 3));
    for (const [name, width] of Object.entries(CAMERA_ATTRIBUTES)) {
      geometry.setAttribute(
          name, new InstancedBufferAttribute(
                    new Float32Array(capacity * width), width));
    }
    geometry.instanceCount = 0;
    const material = new ShaderMaterial({
      uniforms: {size: {value: size}},
      vertexShader: CAMERA_VERTEX,
      fragmentShader: FLAT_FRAGMENT,
    });
    this.capacity = capacity;
    this.object = new LineSegments(geometry, material);
    this.object.frustumCulled = false;
  }

  // `images`: indices of registered images; colorOf(image) is [r, g, b].
  set(images, poses, colorOf) {
    const {geometry} = this.object;
    const {attributes} = geometry;
    let count = 0;
    for (const image of images) {
      if (count === this.capacity) break;
      const camera = poses.camera(image);
      if (!camera) continue;
      const {arrays, header} = poses.data;
      camera.center.toArray(attributes.center.array, 3 * count);
      camera.rotation.toArray(attributes.rotation.array, 4 * count);
      poses.frameCenter(arrays.image_frame[image])
          .toArray(attributes.rigCenter.array, 3 * count);
      attributes.tangents.array.set(
          header.sensors[arrays.image_sensor[image]].half_view_tangents,
          2 * count);
      attributes.tint.array.set(colorOf(image), 3 * count);
      ++count;
    }
    geometry.instanceCount = count;
    for (const name of Object.keys(CAMERA_ATTRIBUTES)) {
      attributes[name].needsUpdate = true;
    }
    this.object.visible = count > 0;
  }

  set size(value) { this.object.material.uniforms.size.value = value; }
}

export function makeLines(positions, color) {
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(positions, 3));
  const lines =
      new LineSegments(geometry, new LineBasicMaterial({color}));
  lines.frustumCulled = false;
  return lines;
}

export function setLines(lines, positions) {
  lines.geometry.setAttribute(
      'position', new BufferAttribute(Float32Array.from(positions), 3));
  lines.visible = positions.length > 0;
}

// Segments between consecutive positions, without those to or from NaN and
// those of more than `maxLength`.
export function pathSegments(positions, maxLength) {
  const segments = [];
  for (let i = 3; i < positions.length; i += 3) {
    const a = positions.subarray(i - 3, i);
    const b = positions.subarray(i, i + 3);
    const length = Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
    if (length <= maxLength) segments.push(...a, ...b);
  }
  return Float32Array.from(segments);
}
