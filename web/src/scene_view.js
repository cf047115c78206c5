// SPDX-License-Identifier: BSD-3-Clause
// The 3D view: what is drawn, from where, and what lies under the pointer.
import {PerspectiveCamera, Quaternion, Scene, Vector3, WebGLRenderer} from 'three';
import {OrbitControls} from 'three/examples/jsm/controls/OrbitControls.js';
import {BodyPhotos, SCALE_OF_CURRENT} from './body_photos.js';
import {cameraColoring, pointColoring} from './coloring.js';
import {CameraBodies, evenOrder, fog, makeGrid, makeLines, makePoints, pathSegments, seamMarks, setLines,
        setPointColors, thinOut} from './drawables.js';
import {fitView, measureModel, roundLength, sideDirection, topDirection} from './framing.js';
import {isRegistered} from './page_data.js';
import {pickCamera, pickPoint} from './picking.js';
import {Poses} from './poses.js';

const MAX_NEAR_CAMERAS = 2000;  // drawn as bodies because they are large
const MAX_FAR_CAMERAS = 300;    // drawn at equal steps in time
const MIN_BODY_PX = 4;
const FOV_DEG = 45;

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

// Until somebody touches it, the view swings about the model.
const SWING_RAD = 0.3, SWING_MS = 30000;

const BAD = [0.84, 0.29, 0.32];
const PATH = 0xd5e6ff;
const OTHER_PATHS = {
  showTruth: ['truth_center', 0x3ecf8e], showOther: ['other_center', 0xc58af9],
  showMeasured: ['measured_center', 0xffb454],
};
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

export class SceneView {
  constructor(stage, canvas, data) {
    this.stage = stage;
    this.options = {
      cameraColor: 'camera', pointColor: null, pointSize: 2, cameraSize: 1,
      showCameras: true, showPoints: true, showPath: true, showTruth: true,
      showGrid: true, showOther: true, showMeasured: true, follow: false,
    };
    this.currentFrame = 0;
    this.selection = null;  // {image} or {point}
    this.through = null;  // the image of the camera through which one looks
    this.onRender = () => {};
    this.onThrough = () => {};  // (image, px from the middle to the edges) or (null)
    this.isSoftware = !hasGraphicsProcessor();
    this.budget = FIRST_BUDGET[this.isSoftware ? 'software' : 'hardware'];
    this.viewNumber = 0;  // of the picture on the canvas
    // The last picture is kept, so that points can be added to it.
    this.renderer = new WebGLRenderer(
        {canvas, alpha: true, antialias: !this.isSoftware, preserveDrawingBuffer: true});
    this.renderer.autoClear = false;
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(FOV_DEG, 1, 1e-4, 100);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.12;
    this.controls.zoomToCursor = true;
    this.controls.addEventListener('change', () => this.requestRender());
    this.controls.addEventListener('start', () => this.touch());
    this.isTouched = false;  // by a person, who chose the view
    // Software draws what moves with few points, so it does not swing.
    this.isSwinging = !this.isSoftware && !matchMedia('(prefers-reduced-motion)').matches;
    this.isSeen = true;
    new IntersectionObserver(([entry]) => {
      this.isSeen = entry.isIntersecting;
      this.requestRender();
    }).observe(stage);
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
    for (const object of [...this.scene.children]) this.disposeObject(object);
    this.makeObjects();
  }

  // The points after more of them have been loaded.
  updatePoints() {
    const {scene, points} = this;
    this.disposeObject(points);
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
    this.shape = measureModel(this.path, this.points.geometry.attributes.position.array, this.up,
                              3 * this.step);
    this.grid = this.makeGround();
    this.photos = new BodyPhotos(this);
    this.hasColors = arrays.point_color.some((value) => value > 0);
    this.options.pointColor ??= this.hasColors ? 'color' : 'height';
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
    this.pathLines = makeLines(pathSegments(registered, maxStep), PATH);
    const thin = thinOut(registered, 300);
    this.coarsePath = makeLines(
        pathSegments(thin, maxStep * registered.length / thin.length), PATH);
    this.otherPaths = Object.entries(OTHER_PATHS).map(
        ([option, [name, color]]) => [option, this.makeOtherPath(name, color)]);
    this.seamLines = makeLines(seamMarks(data.header.seams, this.path, 2 * this.step), 0xff6a5e);
    this.rays = makeLines(new Float32Array(0), 0xe5268c);
    this.measureLine = makeLines(new Float32Array(0), 0xe5268c);
    this.highlight = makePoints(new Float32Array(0), 5);
    this.scene.add(this.points, this.frames, this.pathLines, this.coarsePath, this.seamLines,
                   ...this.otherPaths.map(([, lines]) => lines), this.rays, this.measureLine, this.highlight,
                   this.bodies.object, this.current.object, this.grid);
  }

  makeGround() {
    const {middle, along, ground, radius} = this.shape;
    const {unit} = this.poses;
    this.gridStep = roundLength(radius * unit / 3);
    return makeGrid(middle.clone().addScaledVector(this.up, ground - middle.dot(this.up)),
                    [along, this.up.clone().cross(along)], this.gridStep / unit, 2.5 * radius);
  }

  makeOtherPath(name, color) {
    const centers = this.data.arrays[name];
    if (!centers) return makeLines(new Float32Array(0), color);
    const positions = centers.map((value) => value / this.poses.unit);
    return makeLines(pathSegments(positions, 20 * this.step), color);
  }

  // ------------------------------------------------------------- colors

  recolor() {
    setPointColors(this.points, pointColoring(this.data, this.options.pointColor).colorOf);
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
            pointColoring(this.data, this.options.pointColor)].filter(
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
    const color = getComputedStyle(this.stage).backgroundColor.match(/[\d.]+/g);
    fog.fogColor.value.fromArray(color.map((value) => value / 255));
    if (this.through !== null) this.lookThrough(this.through);
    else if (!this.isTouched) this.resetView();
    this.requestRender();
  }

  // The whole model from the side.
  resetView() { this.lookFrom(sideDirection(this.shape, this.up)); }

  topView() { this.lookFrom(topDirection(this.shape, this.up)); }

  lookFrom(direction) {
    this.leaveCamera();
    const {framed, middle, radius} = this.shape;
    const tangent = Math.tan(0.5 * this.camera.fov * Math.PI / 180);
    const {target, distance} = fitView(framed, middle, direction, this.up,
                                       [tangent * this.camera.aspect, tangent], radius);
    this.camera.position.copy(target).addScaledVector(direction, distance);
    this.controls.target.copy(target);
    this.controls.update();
    this.requestRender();
  }

  // A person takes over.
  touch() {
    this.isTouched = true;
    this.isSwinging = false;
    this.leaveCamera();
  }

  swing(now) {
    this.swingStart ??= now;
    const angleAt = (time) => SWING_RAD * Math.sin(2 * Math.PI * (time - this.swingStart) / SWING_MS);
    this.turn(angleAt(now) - angleAt(this.lastSwing ?? now), 0);
    this.lastSwing = now;
  }

  // Looks at a frame from behind it and above.
  goTo(frame) {
    const {target} = this.controls;
    target.fromArray(this.path, 3 * frame);
    const ahead = new Vector3(0, 0, 1).applyQuaternion(this.poses.worldFromRig(frame));
    this.camera.position.copy(target).addScaledVector(this.up, 10 * this.bodySize())
        .addScaledVector(isRegistered(this.data, frame) ? ahead : this.shape.along,
                         -20 * this.bodySize());
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

  // Puts the view where a camera of the model is, with its field of view.
  lookThrough(image) {
    const pose = this.poses.camera(image);
    if (!pose) return;
    this.touch();
    this.through = image;
    const tangents =
        this.data.header.sensors[this.data.arrays.image_sensor[image]].view_tangents;
    const [left, upper, right, lower] = tangents;
    const {camera} = this;
    const tangent = 1.02 * Math.max(upper, lower, left / camera.aspect, right / camera.aspect);
    camera.fov = 2 * Math.atan(tangent) * 180 / Math.PI;
    camera.position.copy(pose.center);
    // The axes of cameras point to the right, down and forward.
    camera.quaternion.copy(pose.rotation).multiply(new Quaternion(1, 0, 0, 0));
    this.controls.target.copy(pose.center).add(
        new Vector3(0, 0, 4 * this.bodySize()).applyQuaternion(pose.rotation));
    const focal = this.focalPx();
    this.onThrough(image, tangents.map((edge) => edge * focal));
    this.updateCurrent();
    this.requestRender();
  }

  // From its place to one behind it.
  leaveCamera() {
    if (this.through === null) return;
    this.through = null;
    const {camera, controls} = this;
    camera.fov = FOV_DEG;
    camera.position.lerp(controls.target, -1);
    this.onThrough(null);
    this.updateCurrent();
    this.requestRender();
  }

  // -------------------------------------------------------------- frames

  setFrame(frame) {
    const last = this.currentFrame;
    this.currentFrame = frame;
    if (this.options.follow) this.followFrom(last);
    if (this.through !== null) {
      const {image_sensor: sensors} = this.data.arrays;
      const same = this.data.imagesOfFrame[frame].find(
          (image) => sensors[image] === sensors[this.through]);
      if (same !== undefined) this.lookThrough(same);
    }
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
    const images = this.through === null ? this.data.imagesOfFrame[this.currentFrame] ?? [] : [];
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
    if (this.isSwinging && this.isSeen) this.swing(now);
    if (this.through === null) this.controls.update();
    this.adaptBudget(now);
    this.render(this.budget);
    clearTimeout(this.settleTimer);
    this.settleTimer = setTimeout(() => this.settle(), SETTLE_MS);
  }

  // Draws everything, the points bit by bit, so that the page stays responsive.
  settle() {
    const numPoints = this.options.showPoints ? this.numPoints() : 0;
    let drawn = Math.min(numPoints, FIRST_STEP), step = FIRST_STEP, last = 0;
    this.photos.update();
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

  disposeObject(object) {
    object.geometry.dispose();
    object.material.uniforms?.map?.value?.dispose();
    object.material.dispose();
    this.scene.remove(object);
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
    const {radius, spacing} = this.shape;
    fog.fogRange.value.set(distance + radius, distance + 6 * radius);
    this.camera.near = Math.max(1e-3 * distance, 1e-7);
    this.camera.far = 4 * (distance + 4);
    this.camera.updateProjectionMatrix();
    this.points.geometry.setDrawRange(0, Math.min(0.6 * budget, this.numPoints(), maxPoints));
    this.frames.geometry.setDrawRange(0, Math.min(0.1 * budget, data.numFrames));
    const isCoarse = data.numFrames * POINTS_PER_LINE > 0.3 * budget;
    // What software draws slowly is for a view at rest.
    const isDetailed = !this.isSoftware || budget === Infinity;
    this.showChosen(isCoarse, isDetailed);
    const ratio = this.renderer.getPixelRatio();
    const {size, spread} = this.points.material.uniforms;
    // On a photo, points are marks of one size.
    const isOutside = this.through === null;
    size.value = options.pointSize * ratio * (isOutside ? 1 : 2);
    spread.value = isOutside && isDetailed ? 0.5 * options.pointSize * ratio * spacing * this.focalPx() : 0;
    this.highlight.material.uniforms.size.value = (options.pointSize + 1) * ratio;
    this.frames.material.uniforms.size.value = 3 * ratio;
    this.bodies.size = this.bodySize();
    this.current.size = SCALE_OF_CURRENT * this.bodySize();
    const cameras = options.showCameras && this.through === null ? this.chooseCameras() : [];
    this.bodies.set(cameras.slice(0, Math.max(0.3 * budget / POINTS_PER_CAMERA, 20)),
                    this.poses, cameraColoring(this.data, this.options.cameraColor).colorOf);
    this.renderer.clear();
    this.renderer.render(this.scene, this.camera);
    this.onRender();
  }

  // Through a camera, only points are seen, on its photo.
  showChosen(isCoarse, isDetailed) {
    const {options} = this;
    const isOutside = this.through === null;
    const choices = [
      [this.points, options.showPoints], [this.frames, options.showCameras && isOutside],
      [this.pathLines, options.showPath && !isCoarse && isOutside],
      [this.coarsePath, options.showPath && isCoarse && isOutside],
      [this.seamLines, options.showPath && isOutside],
      ...this.otherPaths.map(([option, lines]) => [lines, options[option] && isOutside]),
      [this.grid, options.showGrid && isDetailed && isOutside],
    ];
    for (const [object, isShown] of choices) object.visible = isShown;
    this.photos.setVisible(isOutside && options.showCameras);
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
