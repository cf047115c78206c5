// SPDX-License-Identifier: BSD-3-Clause
import {Details, formatNumber, frameImages, marksOf, picture} from './details.js';
import {roundLength} from './framing.js';
import {LiveRun} from './live.js';
import {addSidePoints, isRegistered, readPageData} from './page_data.js';
import {setUpPairs} from './pair.js';
import {buildControls, buildTools} from './panel.js';
import {Photos} from './photos.js';
import {linkOf, savePicture, saveVideo, showLink} from './saving.js';
import {SceneView} from './scene_view.js';
import {loadSideFiles} from './side_points.js';
import {Vector3} from 'three';

const FRAMES_PER_SECOND = 10;
const MAX_CLICK_MOVE_PX = 5;

const byId = (id) => document.getElementById(id);

// Light, dark, or as the system says until it is chosen.
function setUpTheme() {
  const button = byId('theme');
  const system = matchMedia('(prefers-color-scheme: dark)');
  const isDark = () => (document.documentElement.dataset.theme ??
      (system.matches ? 'dark' : 'light')) === 'dark';
  const label = () => { button.textContent = isDark() ? 'light' : 'dark'; };
  button.addEventListener('click', () => {
    document.documentElement.dataset.theme = isDark() ? 'light' : 'dark';
    label();
  });
  system.addEventListener('change', label);
  label();
  button.hidden = false;
}

class Page {
  constructor(data) {
    byId('view').hidden = false;
    this.measured = null;  // positions while measuring
    this.view = new SceneView(byId('stage'), byId('canvas'), data);
    this.view.onRender = () => {
      this.placeLabels();
      this.showScale();
    };
    this.view.onThrough = (image, edges) => this.showThrough(image, edges);
    this.setUpTools();
    this.setUpTime();
    this.setUpPointer();
    this.setUpKeys();
    this.setUpPrint();
    this.show(data);
    showLink(location.hash, this);
  }

  // Shows other data in the same view.
  replace(data) {
    this.view.setData(data);
    this.show(data);
  }

  show(data) {
    this.data = data;
    this.photos?.dispose();
    this.photos = new Photos(data);
    setUpPairs(this.photos);
    this.details?.show(null);
    this.details = new Details(byId('details'), this.photos, this.view,
                               (selection) => this.select(selection));
    if (this.measured) this.toggleMeasure();
    byId('controls').replaceChildren();
    buildControls(byId('controls'), data, this.view, (button) => this.loadPoints(button));
    this.north = data.header.north && new Vector3(...data.header.north);
    byId('north').hidden = !this.north;
    byId('frame').max = Math.max(data.numFrames - 1, 0);
    this.setFrame(this.view.currentFrame);
    this.setHint();
  }

  // Adds the points of the files beside the page.
  async loadPoints(button) {
    button.disabled = true;
    const {names} = this.data.header.side_points;
    try {
      const files = await loadSideFiles(this.data.header.side_points, (numLoaded) => {
        button.textContent = `loading ${numLoaded + 1} of ${names.length}`;
      });
      addSidePoints(this.data, files);
      this.view.updatePoints();
      button.remove();
    } catch (error) {
      button.textContent = error.message;
    }
  }

  setHint() {
    const isTouch = matchMedia('(pointer: coarse)').matches;
    byId('hint').textContent = this.measured ? 'measure: click two cameras or points' :
        this.view.through !== null ? 'through a camera; drag or Esc: back' :
        isTouch ? 'swipe sideways: turn, two fingers: zoom and move, tap: details' :
        'drag: turn, click and wheel: zoom, right button: move, click: details';
  }

  // ---------------------------------------------------------------- tools

  setUpTools() {
    const {view} = this;
    const section = byId('view');
    buildTools(byId('tools'), {
      reset: () => view.resetView(),
      top: () => view.topView(),
      toggleMeasure: () => this.toggleMeasure(),
      savePicture: () => savePicture(view),
      saveVideo: () => saveVideo(view, byId('save_video')),
      copyLink: async () => {
        const link = linkOf(this);
        history.replaceState(null, '', link);
        await navigator.clipboard?.writeText(location.href).catch(() => {});
        byId('hint').textContent = 'the address of this page is now a link to this view';
      },
      toggleFullScreen: () => (document.fullscreenElement ? document.exitFullscreen() :
                                                            section.requestFullscreen()),
    });
    byId('full_screen').hidden = !section.requestFullscreen;
    byId('save_video').hidden = !window.MediaRecorder;
    for (const kind of ['pointerdown', 'keydown']) {
      section.addEventListener(kind, () => { view.isSwinging = false; });
    }
    // The wheel scrolls the page until the view has been clicked; pinching on a
    // touchpad is a wheel with Ctrl.
    byId('stage').addEventListener('wheel', (event) => {
      view.controls.enableZoom = event.ctrlKey || document.activeElement === byId('stage');
    }, {capture: true});
    byId('stage').addEventListener('pointerleave', (event) => {
      if (event.pointerType === 'mouse' && !event.buttons) byId('stage').blur();
    });
    byId('canvas').style.touchAction = 'pan-y';
    // Warnings and tables refer to frames.
    document.addEventListener('click', (event) => {
      const frame = this.data.frameNames.indexOf(event.target.dataset?.frame);
      if (frame >= 0) this.goToFrame(frame);
    });
  }

  // Shows a frame from near by.
  goToFrame(frame) {
    this.view.touch();
    this.setFrame(frame);
    this.view.goTo(frame);
  }

  showThrough(image, edges) {
    const photo = byId('photo');
    photo.replaceChildren();
    this.setHint();
    if (image === null) return;
    const [left, upper, right, lower] = edges;
    photo.style.transform = `translate(${-left}px, ${-upper}px)`;
    photo.style.width = `${left + right}px`;
    photo.style.height = `${upper + lower}px`;
    photo.append(picture(this.photos, image, marksOf(this.data, image)));
  }

  // A bar of a round length at the distance of the middle of the view.
  showScale() {
    const {view} = this;
    const distance = view.camera.position.distanceTo(view.controls.target);
    const pxPerUnit = view.focalPx() / (distance * view.poses.unit);
    const length = roundLength(120 / pxPerUnit);
    const [bar, label] = byId('scale').querySelectorAll(':scope > i, :scope > i + span');
    byId('scale').style.visibility = view.through === null ? '' : 'hidden';
    bar.style.width = `${length * pxPerUnit}px`;
    const {unit} = this.data.header;
    label.textContent = `${length} ${length === 1 ? unit.replace('units', 'unit') : unit}` + (view.options.showGrid ? `, grid ${view.gridStep} ${unit}` : '');
    if (!this.north) return;
    const tip = this.north.clone().transformDirection(view.camera.matrixWorldInverse);
    byId('north').style.transform = `rotate(${Math.atan2(tip.x, tip.y)}rad)`;
  }

  select(selection) {
    if (this.view.through !== selection?.image) this.view.leaveCamera();
    this.view.select(selection);
    this.details.show(selection);
    if (selection?.image !== undefined) {
      this.setFrame(this.data.arrays.image_frame[selection.image]);
    }
  }

  // ---------------------------------------------------------------- time

  setUpTime() {
    const slider = byId('frame');
    slider.addEventListener('input', () => this.setFrame(Number(slider.value)));
    byId('play').addEventListener('click', () => this.togglePlay());
  }

  setFrame(frame) {
    const {data} = this;
    if (data.numFrames === 0) return;
    const shown = Math.min(Math.max(frame, 0), data.numFrames - 1);
    byId('frame').value = shown;
    const reason = data.header.reasons[data.arrays.frame_reason[shown] - 1];
    byId('frame_name').textContent = `${shown * data.header.frame_step}: ${data.frameNames[shown]}` +
        (isRegistered(data, shown) ? '' : ` – not registered${reason ? `: ${reason}` : ''}`);
    this.view.setFrame(shown);
    byId('frame_images').replaceChildren(
        ...frameImages(this.photos, shown, (selection) => this.select(selection)));
  }

  togglePlay() {
    if (this.playing) {
      clearInterval(this.playing);
      this.playing = null;
    } else {
      this.playing = setInterval(() => {
        const next = this.view.currentFrame + 1;
        this.setFrame(next < this.data.numFrames ? next : 0);
      }, 1000 / FRAMES_PER_SECOND);
    }
    byId('play').textContent = this.playing ? '❚❚' : '▶';
  }

  // ------------------------------------------------------------- pointer

  setUpPointer() {
    const canvas = byId('canvas');
    let down = null;
    canvas.addEventListener('pointerdown', (event) => {
      down = {x: event.clientX, y: event.clientY};
    });
    canvas.addEventListener('pointerup', (event) => {
      const isClick = down && event.button === 0 &&
          Math.hypot(event.clientX - down.x, event.clientY - down.y) <= MAX_CLICK_MOVE_PX;
      down = null;
      if (isClick) this.click(event);
    });
  }

  click(event) {
    const box = byId('stage').getBoundingClientRect();
    const selection = this.view.pick(event.clientX - box.left, event.clientY - box.top);
    if (this.measured) {
      if (selection) this.measure(selection);
    } else {
      this.select(selection);
    }
  }

  // ------------------------------------------------------------- measure

  toggleMeasure() {
    this.measured = this.measured ? null : [];
    byId('measure').setAttribute('aria-pressed', String(Boolean(this.measured)));
    this.view.showMeasure();
    this.setHint();
  }

  measure(selection) {
    const {poses} = this.view;
    const position = selection.image !== undefined ?
        poses.camera(selection.image).center : poses.point(selection.point);
    this.measured = this.measured.length === 1 ? [...this.measured, position] : [position];
    this.view.showMeasure(...this.measured);
  }

  placeLabels() {
    const labels = byId('labels');
    labels.replaceChildren();
    if (this.measured?.length !== 2) return;
    const [from, to] = this.measured;
    const place = this.view.project(from.clone().lerp(to, 0.5));
    if (!place) return;
    const label = document.createElement('span');
    label.textContent =
        `${formatNumber(from.distanceTo(to) * this.view.poses.unit)} ${this.data.header.unit}`;
    label.style.left = `${place.x}px`;
    label.style.top = `${place.y}px`;
    labels.append(label);
  }

  // ---------------------------------------------------------------- keys

  setUpKeys() {
    const {view} = this;
    const actions = {
      ArrowLeft: () => view.turn(0.08, 0),
      ArrowRight: () => view.turn(-0.08, 0),
      ArrowUp: () => view.turn(0, -0.06),
      ArrowDown: () => view.turn(0, 0.06),
      '+': () => view.zoom(0.85),
      '-': () => view.zoom(1 / 0.85),
      r: () => view.resetView(),
      t: () => view.topView(),
      m: () => this.toggleMeasure(),
      f: () => byId('follow').click(),
      ' ': () => this.togglePlay(),
      ',': () => this.setFrame(view.currentFrame - 1),
      '.': () => this.setFrame(view.currentFrame + 1),
      Escape: () => this.select(null),
    };
    byId('stage').addEventListener('keydown', (event) => {
      const action = actions[event.key];
      if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      view.isTouched = true;
      action();
    });
    byId('canvas').addEventListener('pointerdown', () => byId('stage').focus({preventScroll: true}));
  }

  // --------------------------------------------------------------- print

  // A canvas is printed empty; a picture is not.
  setUpPrint() {
    const canvas = byId('canvas');
    const image = document.createElement('img');
    image.style.width = '100%';
    addEventListener('beforeprint', () => {
      this.view.render(Infinity);
      image.src = canvas.toDataURL('image/png');
      canvas.replaceWith(image);
    });
    addEventListener('afterprint', () => image.replaceWith(canvas));
  }
}

// Charts and tables are complete without the 3D view.
function showScene(header, base64) {
  try {
    const data = readPageData(header, base64);
    if (window.mgsfmPage) {
      window.mgsfmPage.replace(data);
    } else {
      window.mgsfmPage = new Page(data);
    }
  } catch (error) {
    console.warn(error);
    byId('view').hidden = true;
    const note = document.createElement('p');
    note.textContent = `This browser does not draw the 3D view (${error.message}). ` +
        'The model from above:';
    byId('plan')?.prepend(note);
    byId('plan')?.removeAttribute('hidden');
  }
}

// All text in these parts was escaped by those who wrote them (sections.h).
function showModel(model) {
  byId('summary_part').innerHTML = model.summary;
  byId('details_part').innerHTML = model.details;
  showScene(model.header, model.arrays);
}

setUpTheme();
byId('written').textContent = `Written ${document.lastModified}. `;
const header = JSON.parse(byId('header').textContent);
if (header.is_live) {
  window.mgsfmLiveRun = new LiveRun(showModel);
} else {
  showScene(header, byId('arrays').textContent);
}
