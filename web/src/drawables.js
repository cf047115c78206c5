// SPDX-License-Identifier: BSD-3-Clause
// The objects of the 3D view.
import {BufferAttribute, BufferGeometry, DoubleSide, InstancedBufferAttribute,
        InstancedBufferGeometry, LineBasicMaterial, LineSegments, Mesh,
        Points, ShaderMaterial, Texture, Vector2, Vector3} from 'three';

// What fades with the distance, in all materials that use it.
export const fog = {
  fogColor: {value: new Vector3()},
  fogRange: {value: new Vector2(1, 2)},  // where it begins and is complete
  fogShare: {value: 0.75},               // what it covers then
};

const POINT_VERTEX = `
attribute vec3 tint;
uniform float size;
uniform float spread;
uniform vec3 fogColor;
uniform vec2 fogRange;
uniform float fogShare;
varying vec3 vTint;
void main() {
  vec4 place = modelViewMatrix * vec4(position, 1.0);
  gl_Position = projectionMatrix * place;
  gl_PointSize = clamp(spread / -place.z, size, 4.0 * size);
  vTint = mix(tint, fogColor, fogShare * smoothstep(fogRange.x, fogRange.y, -place.z));
}`;

// Round, and shaded like balls.
const POINT_FRAGMENT = `
varying vec3 vTint;
void main() {
  vec2 place = 2.0 * gl_PointCoord - 1.0;
  float radius = dot(place, place);
  if (radius > 1.0) discard;
  gl_FragColor = vec4(vTint * (1.0 - 0.3 * radius), 1.0);
}`;

const FLAT_FRAGMENT = `
varying vec3 vTint;
void main() { gl_FragColor = vec4(vTint, 1.0); }`;

// Points with a color each. Their uniforms are `size`, the least diameter in
// pixels, and `spread`, the diameter at a distance of 1.
export function makePoints(positions, size) {
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(positions, 3));
  geometry.setAttribute(
      'tint', new BufferAttribute(new Uint8Array(positions.length), 3, true));
  const material = new ShaderMaterial({
    uniforms: {size: {value: size}, spread: {value: 0}, ...fog},
    vertexShader: POINT_VERTEX,
    fragmentShader: POINT_FRAGMENT,
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

const GRID_VERTEX = `
uniform vec3 middle;
varying vec3 vPlace;
void main() {
  vPlace = position - middle;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

const GRID_FRAGMENT = `
uniform float radius;
varying vec3 vPlace;
void main() {
  gl_FragColor = vec4(0.55, 0.65, 0.8, 0.3 * smoothstep(radius, 0.2 * radius, length(vPlace)));
}`;

// The edges of squares of `step` along two axes of the plane through `middle`,
// that fade out at `radius`. Edges are short, since software renderers omit
// lines that pass the viewer.
export function makeGrid(middle, axes, step, radius) {
  const count = Math.ceil(radius / step);
  const positions = [];
  for (const [along, across] of [axes, [axes[1], axes[0]]]) {
    for (let i = -count; i <= count; ++i) {
      for (let k = -count; k < count; ++k) {
        for (const end of [k, k + 1]) {
          positions.push(...middle.clone().addScaledVector(across, i * step)
                             .addScaledVector(along, end * step).toArray());
        }
      }
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(Float32Array.from(positions), 3));
  const grid = new LineSegments(geometry, new ShaderMaterial({
    uniforms: {middle: {value: middle}, radius: {value: radius}},
    vertexShader: GRID_VERTEX,
    fragmentShader: GRID_FRAGMENT,
    transparent: true,
    depthWrite: false,
  }));
  grid.frustumCulled = false;
  return grid;
}

const PHOTO_VERTEX = `
varying vec2 vPlace;
void main() {
  vPlace = uv;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

const PHOTO_FRAGMENT = `
uniform sampler2D map;
varying vec2 vPlace;
void main() { gl_FragColor = texture2D(map, vPlace); }`;

// A picture in the image plane of a camera, whose corners are given row by row.
export function makePhoto(corners, jpeg, onLoad) {
  const geometry = new BufferGeometry();
  geometry.setAttribute(
      'position', new BufferAttribute(Float32Array.from(corners.flatMap((p) => p.toArray())), 3));
  geometry.setAttribute(
      'uv', new BufferAttribute(new Float32Array([0, 0, 1, 0, 0, 1, 1, 1]), 2));
  geometry.setIndex([0, 1, 2, 2, 1, 3]);
  const photo = new Mesh(geometry, new ShaderMaterial({
    uniforms: {map: {value: null}},
    vertexShader: PHOTO_VERTEX,
    fragmentShader: PHOTO_FRAGMENT,
    side: DoubleSide,
  }));
  photo.frustumCulled = false;
  photo.visible = false;
  createImageBitmap(new Blob([jpeg], {type: 'image/jpeg'})).then((bitmap) => {
    const texture = new Texture(bitmap);
    texture.flipY = false;
    texture.needsUpdate = true;
    photo.material.uniforms.map.value = texture;
    photo.visible = true;
    onLoad();
  }, () => {});  // without a picture, the edges remain
  return photo;
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
          header.sensors[arrays.image_sensor[image]].view_tangents.slice(0, 2),
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

// Numbers below `size` in an order of which each prefix is spread evenly.
export function evenOrder(size) {
  const golden = 0.6180339887498949;
  return Array.from({length: size}, (_, i) => i)
      .sort((a, b) => (a * golden) % 1 - (b * golden) % 1);
}

// Every k-th position of a path, so that at most `size` are left.
export function thinOut(path, size) {
  const step = Math.ceil(path.length / 3 / size);
  const positions = [];
  for (let i = 0; i < path.length; i += 3 * step) {
    positions.push(path[i], path[i + 1], path[i + 2]);
  }
  return Float32Array.from(positions);
}

// A cross on each seam, and the line between the frames beside it.
export function seamMarks(seams, path, size) {
  const segments = [];
  for (const [before, after] of seams) {
    const ends = [before, after].map(
        (frame) => new Vector3().fromArray(path, 3 * frame));
    segments.push(...ends[0].toArray(), ...ends[1].toArray());
    const middle = ends[0].lerp(ends[1], 0.5);
    for (let axis = 0; axis < 3; ++axis) {
      for (const sign of [-1, 1]) {
        const tip = middle.clone();
        tip.setComponent(axis, tip.getComponent(axis) + sign * size);
        segments.push(...tip.toArray());
      }
    }
  }
  return Float32Array.from(segments);
}
