// SPDX-License-Identifier: BSD-3-Clause
// A view as a picture, a video, or a link.
import {Vector3} from 'three';

const VIDEO_MS = 10000, VIDEO_FRAMES_PER_S = 30;

function save(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// Draws the view on a canvas with the color of the stage behind it.
function composite(view, canvas) {
  const {domElement: drawn} = view.renderer;
  canvas.width = drawn.width;
  canvas.height = drawn.height;
  const context = canvas.getContext('2d');
  context.fillStyle = getComputedStyle(view.stage).backgroundColor;
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.drawImage(drawn, 0, 0);
  return canvas;
}

export function savePicture(view) {
  view.render(Infinity);
  composite(view, document.createElement('canvas'))
      .toBlob((blob) => save(blob, 'model.png'), 'image/png');
}

// Records one turn about the model.
export function saveVideo(view, button) {
  const canvas = composite(view, document.createElement('canvas'));
  const recorder = new MediaRecorder(canvas.captureStream(VIDEO_FRAMES_PER_S),
                                     {videoBitsPerSecond: 12e6});
  const parts = [];
  recorder.ondataavailable = ({data}) => parts.push(data);
  recorder.onstop = () => {
    button.disabled = false;
    save(new Blob(parts, {type: recorder.mimeType}), 'model.webm');
  };
  button.disabled = true;
  view.touch();
  recorder.start();
  let start = null, turned = 0;
  const record = (now) => {
    start ??= now;
    const angle = 2 * Math.PI * Math.min((now - start) / VIDEO_MS, 1);
    view.turn(angle - turned, 0);
    turned = angle;
    view.render(view.budget);
    composite(view, canvas);
    if (now - start < VIDEO_MS) requestAnimationFrame(record);
    else recorder.stop();
  };
  requestAnimationFrame(record);
}

// "#view=FRAME,x,y,z,x,y,z": the places of the viewer and of what is looked at,
// in the world of the model.
export function linkOf({view}) {
  const places = [view.camera.position, view.controls.target].flatMap(
      (place) => view.poses.toWorld(place).toArray());
  return `#view=${[view.currentFrame, ...places.map((x) => Number(x.toPrecision(9)))].join(',')}`;
}

export function showLink(hash, page) {
  const values = hash.startsWith('#view=') ? hash.slice(6).split(',').map(Number) : [];
  if (values.length !== 7 || !values.every(Number.isFinite)) return;
  const {view} = page;
  page.setFrame(values[0]);
  view.touch();
  [view.camera.position, view.controls.target].forEach((place, i) => place.copy(
      view.poses.fromWorld(new Vector3(...values.slice(1 + 3 * i, 4 + 3 * i)))));
  view.controls.update();
  view.requestRender();
}
