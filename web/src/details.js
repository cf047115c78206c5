// SPDX-License-Identifier: BSD-3-Clause
// What is known about the selected camera or point. All names are data: they
// only become text, never markup.
import {cssColor, sequentialColor} from './colors.js';

const MAX_PICTURES = 12;

export function element(tag, properties = {}, children = []) {
  const node = document.createElement(tag);
  Object.assign(node, properties);
  node.append(...children);
  return node;
}

function name(text) {
  return element('bdi', {textContent: text});
}

function table(rows) {
  const body = element('tbody');
  for (const [label, value] of rows) {
    const content = typeof value === 'string' ? name(value) : value;
    body.append(element('tr', {}, [
      element('th', {scope: 'row', textContent: label}),
      element('td', {}, [content]),
    ]));
  }
  return element('table', {}, [body]);
}

export function formatNumber(value, digits = 4) {
  return Number.isFinite(value) ? String(Number(value.toPrecision(digits))) : '–';
}

// The image whose thumbnail stands for this one: itself or, if it has none, the
// nearest in time of the same camera. undefined if there is none.
function nearestThumbnail(data, image) {
  if (data.thumbnails.has(image)) return image;
  const {image_frame: frames, image_sensor: sensors} = data.arrays;
  let best, bestDistance = Infinity;
  for (const other of data.thumbnails.keys()) {
    const distance = Math.abs(frames[other] - frames[image]);
    if (sensors[other] !== sensors[image] || distance >= bestDistance) continue;
    best = other;
    bestDistance = distance;
  }
  return best;
}

// A picture with marks {x, y, error} at fractions of its size.
function picture(data, image, marks, urls) {
  const sensor = data.header.sensors[data.arrays.image_sensor[image]];
  const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  svg.setAttribute('viewBox', `0 0 ${sensor.width_px} ${sensor.height_px}`);
  for (const mark of marks) {
    const dot = document.createElementNS('http://www.w3.org/2000/svg', 'circle');
    dot.setAttribute('cx', mark.x / 255 * sensor.width_px);
    dot.setAttribute('cy', mark.y / 255 * sensor.height_px);
    dot.setAttribute('r', mark.radius * sensor.width_px);
    dot.setAttribute('fill', cssColor(sequentialColor(mark.error / 64)));
    dot.setAttribute('stroke', '#0008');
    dot.setAttribute('stroke-width', 0.002 * sensor.width_px);
    svg.append(dot);
  }
  const url = URL.createObjectURL(
      new Blob([data.thumbnails.get(image)], {type: 'image/jpeg'}));
  urls.push(url);
  return element('div', {className: 'picture'}, [
    element('img', {src: url, alt: data.imageNames[image]}), svg,
  ]);
}

export class Details {
  // `onSelect` receives {image} or {point}.
  constructor(root, data, view, onSelect) {
    Object.assign(this, {root, data, view, onSelect, urls: []});
  }

  show(selection) {
    this.urls.forEach((url) => URL.revokeObjectURL(url));
    this.urls = [];
    this.root.replaceChildren();
    if (selection?.image !== undefined) this.showCamera(selection.image);
    if (selection?.point !== undefined) this.showPoint(selection.point);
  }

  showCamera(image) {
    const {data, view} = this;
    const {arrays} = data;
    const {starts, order} = data.tracksOfImage;
    const marks = [];
    const radius = starts[image + 1] - starts[image] > 500 ? 0.0035 : 0.006;
    for (let k = starts[image]; k < starts[image + 1]; ++k) {
      const i = order[k];
      marks.push({x: data.tracks.x[i], y: data.tracks.y[i],
                  error: data.tracks.error[i], radius});
    }
    const shown = nearestThumbnail(data, image);
    if (shown !== undefined) {
      const own = shown === image;
      this.root.append(element('figure', {}, [
        picture(data, shown, own ? marks : [], this.urls),
        element('figcaption', {}, own ?
            [`${marks.length} of ${arrays.image_num_points[image]} points; color: error, 0 to 2 px`] :
            ['nearest thumbnail of this camera: ', name(data.imageNames[shown])]),
      ]));
    }
    const frame = arrays.image_frame[image];
    const pose = view.poses.camera(image);
    const rows = [
      ['image', data.imageNames[image]],
      ['camera', data.header.sensors[arrays.image_sensor[image]].name],
      ['frame', `${frame * data.header.frame_step}: ${data.frameNames[frame]}`],
      ['points', String(arrays.image_num_points[image])],
      ['mean error', `${formatNumber(arrays.image_error_px[image], 3)} px`],
    ];
    if (pose) {
      const position = view.poses.toWorld(pose.center).toArray();
      rows.push(['position', position.map((x) => formatNumber(x, 6)).join(', ')]);
    }
    this.addErrors('truth', 'error of the frame', frame, rows);
    this.addErrors('other', 'difference of the frame', frame, rows);
    const look = element('button', {type: 'button', textContent: 'look through'});
    look.addEventListener('click', () => view.lookThrough(image));
    this.root.append(element('div', {}, [table(rows), look]));
  }

  addErrors(prefix, label, frame, rows) {
    const positions = this.data.arrays[`${prefix}_position_error`];
    if (!positions || !Number.isFinite(positions[frame])) return;
    const rotation = this.data.arrays[`${prefix}_rotation_error_deg`][frame];
    rows.push([label, `${formatNumber(positions[frame])}, ${formatNumber(rotation, 3)}°`]);
  }

  showPoint(point) {
    const {data, view} = this;
    const {arrays, tracks} = data;
    const track = view.trackOf(point);
    const position = view.poses.toWorld(view.poses.point(point)).toArray();
    const error = arrays.point_error[point] / 32;
    this.root.append(element('div', {}, [table([
      ['point', position.map((x) => formatNumber(x, 6)).join(', ')],
      ['images', String(arrays.point_length[point])],
      ['mean error', `${error >= 255 / 32 ? '8 or more' : formatNumber(error, 2)} px`],
      ...(track.length > 0 ? [] : [['track', 'not stored in this page']]),
    ])]));
    const list = element('div', {className: 'track'});
    for (const k of track) {
      const image = tracks.image[k];
      const caption = element('button', {type: 'button', title: data.imageNames[image]},
                              [name(data.imageNames[image])]);
      caption.addEventListener('click', () => this.onSelect({image}));
      const error = tracks.error[k];
      const parts = [element('figcaption', {}, [
        caption, ` ${error === 255 ? '8 or more' : formatNumber(error / 32, 2)} px`])];
      if (data.thumbnails.has(image) && list.children.length < MAX_PICTURES) {
        const mark = {x: tracks.x[k], y: tracks.y[k], error, radius: 0.02};
        parts.unshift(picture(data, image, [mark], this.urls));
      }
      list.append(element('figure', {}, parts));
    }
    this.root.append(list);
  }
}
