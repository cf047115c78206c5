// SPDX-License-Identifier: BSD-3-Clause
// The 3D view: what is drawn, from where, and what lies under the pointer.
import {PerspectiveCamera, Quaternion, Scene, Vector3, WebGLRenderer} from 'three';
import {OrbitControls} from 'three/examples/jsm/controls/OrbitControls.js';
import {cameraColoring, pointColoring} from './coloring.js';
import {CameraBodies, makeLines, makePoints, pathSegments, setLines, setPointColors} from './drawables.js';
import {isRegistered} from './page_data.js';
import {pickCamera, pickPoint} from './picking.js';
import {Poses} from './poses.js';

const MAX_NEAR_CAMERAS = 2000;  // drawn as bodies because they are large
const MAX_FAR_CAMERAS = 300;    // drawn at equal steps in time
const MIN_BODY_PX = 4;

// While the view moves, it is drawn with a budget of points that follows the
// speed of the computer; when it rests, everything is drawn.
const MAX_FRAME_MS = 40;
const SETTLE_MS = 250;
const MIN_BUDGET = 2000, MAX_BUDGET = 1e7;
const FIRST_BUDGET = {hardware: 400000, software: 5000};
// A line costs as much as so many points, a camera has eleven lines.
const POINTS_PER_LINE = 4, POINTS_PER_CAMERA = 40;
// When the view rests, points are added so many at a time; then as the speed of
// the computer permits.
const FIRST_STEP = 100000, MIN_STEP = 20000;

const BAD = [0.84, 0.29, 0.32];
const SELECTED = [0.9, 0.15, 0.55];

function hasGraphicsProcessor() {
  const context = document.createElement('canvas').getContext('webgl2');
  if (!context) return false;
  const names = context.getExtension('WEBGL_debug_renderer_info');
  const renderer = context.getParameter(
      names ? names.UNMASKED_RENDERER_WEBGL : context.RENDERER);
  context.getExtension('WEBGL_lose_context')?.loseContext();
  return !/swiftshader|llvmpipe|software|basic render/i.test(renderer);
}

// Numbers below `size` in an order of which each prefix is spread evenly.
function evenOrder(size) {
  const golden = 0.6180339887498949;
  return Array.from({length: size}, (_, i) => i)
      .sort((a, b) => (a * golden) % 1 - (b * golden) % 1);
}

// Every k-th position of a path, so that at most `size` are left.
function thinOut(path, size) {
  const step = Math.ceil(path.length / 3 / size);
  const positions = [];
  for (let i = 0; i < path.length; i += 3 * step) {
    positions.push(path[i], path[i + 1], path[i + 2]);
  }
  return Float32Array.from(positions);
}

export class SceneView {
  constructor(stage, canvas, data) {
    this.stage = stage;
    this.options = {
      cameraColor: 'camera', pointColor: 'color', pointSize: 2, cameraSize: 1,
      showCameras: true, showPoints: true, showPath: true, showTruth: true,
      showOther: true, follow: false,
    };
    this.currentFrame = 0;
    this.selection = null;  // {image} or {point}
    this.onRender = () => {};
    const isSoftware = !hasGraphicsProcessor();
    this.budget = FIRST_BUDGET[isSoftware ? 'software' : 'hardware'];
    this.viewNumber = 0;  // of the picture on the canvas
    // The last picture is kept, so that points can be added to it.
    this.renderer = new WebGLRenderer(
        {canvas, alpha: true, antialias: !isSoftware, preserveDrawingBuffer: true});
    this.renderer.autoClear = false;
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(45, 1, 1e-4, 100);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.12;
    this.controls.zoomToCursor = true;
    this.controls.addEventListener('change', () => this.requestRender());
    this.controls.addEventListener('start', () => { this.isTouched = true; });
    this.isTouched = false;  // by a person, who chose the view
    this.setData(data);
    new ResizeObserver(() => this.resize()).observe(stage);
    this.resize();
  }

  // Shows other data. A view that a person chose stays at its place in the
  // world of the model.
  setData(data) {
    const places = this.isTouched ?
        [this.camera.position, this.controls.target].map((place) => this.poses.toWorld(place)) :
        null;
    this.data = data;
    this.poses = new Poses(data);
    this.up = new Vector3(...data.header.up);
    this.camera.up.copy(this.up);
    this.replaceObjects();
    this.selection = null;
    this.currentFrame = Math.min(this.currentFrame, Math.max(data.numFrames - 1, 0));
    if (places) {
      [this.camera.position, this.controls.target].forEach(
          (place, i) => place.copy(this.poses.fromWorld(places[i])));
      this.controls.update();
    } else {
      this.resetView();
    }
    this.recolor();
  }

  replaceObjects() {
    for (const object of [...this.scene.children]) {
      object.geometry.dispose();
      object.material.dispose();
      this.scene.remove(object);
    }
    this.makeObjects();
  }

  // The points after more of them have been loaded.
  updatePoints() {
    const {scene, points} = this;
    scene.remove(points);
    points.geometry.dispose();
    points.material.dispose();
    this.points = this.makePointCloud();
    scene.add(this.points);
    this.recolor();
  }

  makePointCloud() {
    const positions = this.data.pointPositions.slice();
    for (let i = 0; i < positions.length; ++i) positions[i] /= this.poses.unit;
    return makePoints(positions, 2);
  }

  makeObjects() {
    const {data, poses} = this;
    const {arrays} = data;
    this.step = poses.medianStep() || 0.02;
    this.path = poses.pathPositions();
    this.points = this.makePointCloud();
    this.hasColors = arrays.point_color.some((value) => value > 0);
    this.markedFrames = evenOrder(data.numFrames);
    const marks = new Float32Array(3 * data.numFrames);
    this.markedFrames.forEach((frame, i) => {
      const place = this.path.subarray(3 * frame, 3 * frame + 3);
      if (!Number.isNaN(place[0])) marks.set(place, 3 * i);
    });
    this.frames = makePoints(marks, 4);
    this.bodies = new CameraBodies(MAX_NEAR_CAMERAS + MAX_FAR_CAMERAS, 1);
    this.current = new CameraBodies(64, 1);
    const registered = this.path.slice();
    for (let i = 0; i < data.numFrames; ++i) {
      if (!isRegistered(data, i)) registered.fill(NaN, 3 * i, 3 * i + 3);
    }
    const maxStep = 20 * this.step;
    this.pathLines = makeLines(pathSegments(registered, maxStep), 0x7d8794);
    const thin = thinOut(registered, 300);
    this.coarsePath = makeLines(
        pathSegments(thin, maxStep * registered.length / thin.length), 0x7d8794);
    this.truthLines = this.makeOtherPath('truth_center', 0x2e8b57);
    this.otherLines = this.makeOtherPath('other_center', 0x9b59b6);
    this.seamLines = makeLines(this.seamMarks(), 0xe0483e);
    this.rays = makeLines(new Float32Array(0), 0xe5268c);
    this.measureLine = makeLines(new Float32Array(0), 0xe5268c);
    this.highlight = makePoints(new Float32Array(0), 5);
    this.scene.add(this.points, this.frames, this.pathLines,
                   this.coarsePath, this.seamLines, this.truthLines, this.otherLines, this.rays, this.measureLine,
                   this.highlight, this.bodies.object, this.current.object);
  }

  // A cross on each seam, and the line between the frames beside it.
  seamMarks() {
    const segments = [];
    const size = 2 * this.step;
    for (const [before, after] of this.data.header.seams) {
      const ends = [before, after].map(
          (frame) => new Vector3().fromArray(this.path, 3 * frame));
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

  makeOtherPath(name, color) {
    const centers = this.data.arrays[name];
    if (!centers) return makeLines(new Float32Array(0), color);
    const positions = centers.map((value) => value / this.poses.unit);
    return makeLines(pathSegments(positions, 20 * this.step), color);
  }

  // ------------------------------------------------------------- colors

  recolor() {
    setPointColors(this.points, pointColoring(this.data, this.options.pointColor,
                                              this.hasColors).colorOf);
    const {colorOf} = cameraColoring(this.data, this.options.cameraColor);
    const images = this.data.imagesOfFrame;
    setPointColors(this.frames, (i) => {
      const frame = this.markedFrames[i];
      if (!isRegistered(this.data, frame)) return BAD;
      return images[frame].length > 0 ? colorOf(images[frame][0]) : [0.5, 0.5, 0.5];
    });
    this.updateCurrent();
    this.requestRender();
  }

  // The entries of the legend: [name, css color] or a scale.
  legends() {
    return [cameraColoring(this.data, this.options.cameraColor),
            pointColoring(this.data, this.options.pointColor, this.hasColors)].filter(
        (coloring) => coloring.label || coloring.names);
  }

  // ---------------------------------------------------------------- view

  resize() {
    const {clientWidth: width, clientHeight: height} = this.stage;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.requestRender();
  }

  // The middle and radius of most frames, or of the points without frames.
  focus() {
    const positions = this.path.some(Number.isFinite) ?
        this.path : this.points.geometry.attributes.position.array;
    const middle = new Vector3();
    let radius = 0;
    for (let c = 0; c < 3; ++c) {
      const values = [];
      for (let i = c; i < positions.length; i += 3) {
        if (Number.isFinite(positions[i])) values.push(positions[i]);
      }
      values.sort((a, b) => a - b);
      if (values.length === 0) return {middle, radius: 1};
      const low = values[Math.floor(0.01 * (values.length - 1))];
      const high = values[Math.ceil(0.99 * (values.length - 1))];
      middle.setComponent(c, 0.5 * (low + high));
      radius = Math.hypot(radius, 0.5 * (high - low));
    }
    return {middle, radius: Math.min(Math.max(radius, 3 * this.step, 0.02), 2)};
  }

  // From behind and above, the direction of travel towards the top.
  resetView() {
    const {middle, radius} = this.focus();
    this.lookFrom(middle, radius, this.behind().addScaledVector(this.up, 0.5));
  }

  topView() {
    const {middle, radius} = this.focus();
    this.lookFrom(middle, radius,
                  this.up.clone().addScaledVector(this.behind(), 1e-3));
  }

  // The horizontal direction against the direction of travel.
  behind() {
    const known = [];
    for (let i = 0; i < this.data.numFrames; ++i) {
      if (isRegistered(this.data, i)) known.push(i);
    }
    const direction = new Vector3();
    if (known.length > 1) {
      direction.copy(this.poses.frameCenter(known[0]))
          .sub(this.poses.frameCenter(known[known.length - 1]));
    }
    direction.addScaledVector(this.up, -direction.dot(this.up));
    if (direction.length() < 1e-6) {
      direction.set(0.3, 0.7, -0.6).cross(this.up);
    }
    return direction.normalize();
  }

  lookFrom(target, radius, direction) {
    const distance = 0.9 * radius / Math.tan(0.5 * this.camera.fov * Math.PI / 180);
    this.camera.position.copy(target)
        .addScaledVector(direction.normalize(), distance);
    this.controls.target.copy(target);
    this.controls.update();
    this.requestRender();
  }

  // Turns the view about its target.
  turn(left, up) {
    const offset = this.camera.position.clone().sub(this.controls.target);
    offset.applyAxisAngle(this.up, left);
    const side = this.up.clone().cross(offset).normalize();
    const angle = offset.angleTo(this.up) + up;
    if (angle > 0.02 && angle < 3.12) offset.applyAxisAngle(side, up);
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.requestRender();
  }

  zoom(factor) {
    this.camera.position.sub(this.controls.target).multiplyScalar(factor)
        .add(this.controls.target);
    this.controls.update();
    this.requestRender();
  }

  // Puts the view where a camera of the model is.
  lookThrough(image) {
    const pose = this.poses.camera(image);
    if (!pose) return;
    const forward = new Vector3(0, 0, 1).applyQuaternion(pose.rotation);
    const distance = 4 * this.bodySize();
    this.camera.position.copy(pose.center).addScaledVector(forward, -distance);
    this.controls.target.copy(pose.center)
        .addScaledVector(forward, distance);
    this.controls.update();
    this.requestRender();
  }

  // -------------------------------------------------------------- frames

  setFrame(frame) {
    const last = this.currentFrame;
    this.currentFrame = frame;
    if (this.options.follow) this.followFrom(last);
    this.updateCurrent();
    this.requestRender();
  }

  // Moves and turns the view with the rig.
  followFrom(last) {
    const {data, poses, currentFrame: frame} = this;
    if (!isRegistered(data, frame)) return;
    const offset = this.camera.position.clone().sub(this.controls.target);
    const maxDistance = 40 * this.bodySize();
    if (offset.length() > maxDistance) offset.setLength(maxDistance);
    if (isRegistered(data, last)) {
      const turn = poses.worldFromRig(frame).multiply(
          poses.worldFromRig(last).invert());
      const forward = offset.clone().projectOnPlane(this.up);
      const turned = forward.clone().applyQuaternion(turn).projectOnPlane(this.up);
      if (forward.lengthSq() > 0 && turned.lengthSq() > 0) {
        offset.applyQuaternion(new Quaternion().setFromUnitVectors(
            forward.normalize(), turned.normalize()));
      }
    }
    this.controls.target.copy(poses.frameCenter(frame));
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
  }

  updateCurrent() {
    const images = this.data.imagesOfFrame[this.currentFrame] ?? [];
    this.current.set(images, this.poses, () => SELECTED);
  }

  select(selection) {
    this.selection = selection;
    const rays = [];
    const chosen = [];
    const {tracks, tracksOfImage} = this.data;
    if (selection?.image !== undefined) {
      const {starts, order} = tracksOfImage;
      for (let k = starts[selection.image]; k < starts[selection.image + 1]; ++k) {
        chosen.push(tracks.point[order[k]]);
      }
    } else if (selection?.point !== undefined) {
      const target = this.poses.point(selection.point);
      chosen.push(selection.point);
      for (const k of this.trackOf(selection.point)) {
        const pose = this.poses.camera(tracks.image[k]);
        if (pose) rays.push(...pose.center.toArray(), ...target.toArray());
      }
    }
    setLines(this.rays, rays);
    this.showHighlight(chosen);
    this.requestRender();
  }

  showHighlight(indices) {
    this.scene.remove(this.highlight);
    const positions = new Float32Array(3 * indices.length);
    const position = new Vector3();
    indices.forEach((index, i) => this.poses.point(index, position).toArray(positions, 3 * i));
    this.highlight = makePoints(positions, this.options.pointSize + 3);
    setPointColors(this.highlight, () => SELECTED);
    this.scene.add(this.highlight);
  }

  // Indices into data.tracks; none if the track is not stored.
  trackOf(point) {
    const {starts} = this.data.tracks;
    if (point + 1 >= starts.length) return [];
    return Array.from({length: starts[point + 1] - starts[point]},
                      (_, i) => starts[point] + i);
  }

  showMeasure(from, to) {
    setLines(this.measureLine,
             from && to ? [...from.toArray(), ...to.toArray()] : []);
    this.requestRender();
  }

  // ------------------------------------------------------------- drawing

  bodySize() {
    return 0.7 * this.step * this.options.cameraSize;
  }

  // Pixels of a length of 1 at a distance of 1.
  focalPx() {
    return 0.5 * this.stage.clientHeight /
        Math.tan(0.5 * this.camera.fov * Math.PI / 180);
  }

  // Cameras that are large enough to be recognized, and some of the others.
  chooseCameras() {
    const {data} = this;
    const maxDistance = this.bodySize() * this.focalPx() / MIN_BODY_PX;
    const eye = this.camera.position;
    const near = [];
    const distances = new Map();
    for (let frame = 0; frame < data.numFrames; ++frame) {
      const distance = Math.hypot(this.path[3 * frame] - eye.x,
                                  this.path[3 * frame + 1] - eye.y,
                                  this.path[3 * frame + 2] - eye.z);
      if (distance < maxDistance) {
        near.push(frame);
        distances.set(frame, distance);
      }
    }
    near.sort((a, b) => distances.get(a) - distances.get(b));
    const chosen = [];
    const isChosen = new Set();
    const add = (frame) => {
      if (isChosen.has(frame)) return;
      isChosen.add(frame);
      chosen.push(...data.imagesOfFrame[frame]);
    };
    for (const frame of near) {
      if (chosen.length >= MAX_NEAR_CAMERAS) break;
      add(frame);
    }
    const step = Math.max(1, Math.ceil(data.numImages / MAX_FAR_CAMERAS));
    for (let frame = 0; frame < data.numFrames; frame += step) add(frame);
    return chosen;
  }

  requestRender() {
    if (this.isRequested) return;
    this.isRequested = true;
    requestAnimationFrame((now) => this.draw(now));
  }

  draw(now) {
    this.isRequested = false;
    this.controls.update();
    this.adaptBudget(now);
    this.render(this.budget);
    clearTimeout(this.settleTimer);
    this.settleTimer = setTimeout(() => this.settle(), SETTLE_MS);
  }

  // Draws everything, the points bit by bit, so that the page stays responsive.
  settle() {
    const numPoints = this.options.showPoints ? this.numPoints() : 0;
    let drawn = Math.min(numPoints, FIRST_STEP), step = FIRST_STEP, last = 0;
    this.render(Infinity, drawn);
    const view = ++this.viewNumber;
    const addPoints = (now) => {
      if (view !== this.viewNumber || drawn >= numPoints) return;
      const elapsed = now - last;
      if (last > 0) step = Math.max(elapsed > MAX_FRAME_MS ? step / 2 : step * 1.5, MIN_STEP);
      last = now;
      this.renderPoints(drawn, Math.ceil(step));
      drawn += Math.ceil(step);
      requestAnimationFrame(addPoints);
    };
    requestAnimationFrame(addPoints);
  }

  numPoints() { return this.data.pointPositions.length / 3; }

  // Adds points to the last picture.
  renderPoints(start, count) {
    const others = this.scene.children.filter((object) => object !== this.points && object.visible);
    for (const object of others) object.visible = false;
    this.points.geometry.setDrawRange(start, count);
    this.renderer.render(this.scene, this.camera);
    for (const object of others) object.visible = true;
  }

  adaptBudget(now) {
    const elapsed = now - (this.lastDraw ?? 0);
    this.lastDraw = now;
    if (elapsed > 10 * MAX_FRAME_MS) return;  // it rested in between
    if (elapsed > MAX_FRAME_MS) {
      this.budget = Math.max(0.7 * this.budget, MIN_BUDGET);
    } else if (elapsed < 0.6 * MAX_FRAME_MS) {
      this.budget = Math.min(1.1 * this.budget, MAX_BUDGET);
    }
  }

  // Draws about as much as so many points cost, and at most `maxPoints` points.
  render(budget, maxPoints = Infinity) {
    const {options, data} = this;
    ++this.viewNumber;
    const distance = this.camera.position.distanceTo(this.controls.target);
    this.camera.near = Math.max(1e-3 * distance, 1e-7);
    this.camera.far = 4 * (distance + 4);
    this.camera.updateProjectionMatrix();
    this.points.geometry.setDrawRange(0, Math.min(0.6 * budget, this.numPoints(), maxPoints));
    this.frames.geometry.setDrawRange(0, Math.min(0.1 * budget, data.numFrames));
    const isCoarse = data.numFrames * POINTS_PER_LINE > 0.3 * budget;
    this.showChosen(isCoarse);
    const ratio = this.renderer.getPixelRatio();
    this.points.material.uniforms.size.value = options.pointSize * ratio;
    this.highlight.material.uniforms.size.value = (options.pointSize + 1) * ratio;
    this.frames.material.uniforms.size.value = 3 * ratio;
    this.bodies.size = this.bodySize();
    this.current.size = 1.3 * this.bodySize();
    const cameras = options.showCameras ? this.chooseCameras() : [];
    this.bodies.set(cameras.slice(0, Math.max(0.3 * budget / POINTS_PER_CAMERA, 20)),
                    this.poses, cameraColoring(this.data, this.options.cameraColor).colorOf);
    this.renderer.clear();
    this.renderer.render(this.scene, this.camera);
    this.onRender();
  }

  showChosen(isCoarse) {
    const {options} = this;
    this.points.visible = options.showPoints;
    this.frames.visible = options.showCameras;
    this.pathLines.visible = options.showPath && !isCoarse;
    this.coarsePath.visible = options.showPath && isCoarse;
    this.seamLines.visible = options.showPath;
    this.truthLines.visible = options.showTruth;
    this.otherLines.visible = options.showOther;
  }

  // ------------------------------------------------------------- picking

  // CSS pixels in the stage, or null behind the viewer.
  project(position) {
    const p = position.clone().project(this.camera);
    if (p.z > 1 || p.z < -1) return null;
    return {
      x: 0.5 * (p.x + 1) * this.stage.clientWidth,
      y: 0.5 * (1 - p.y) * this.stage.clientHeight,
    };
  }

  // {image}, {point} or null for what is drawn near a pixel of the stage.
  pick(x, y) {
    const image = this.options.showCameras ? pickCamera(this, x, y) : null;
    if (image !== null) return {image};
    const point = this.options.showPoints ? this.pickPoint(x, y) : null;
    return point !== null ? {point} : null;
  }

  pickPoint(x, y) { return pickPoint(this, x, y); }
}
