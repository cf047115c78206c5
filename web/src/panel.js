// SPDX-License-Identifier: BSD-3-Clause
// The controls in and beside the 3D view.
import {cssColor, sequentialColor} from './colors.js';
import {count, element, formatNumber} from './details.js';

function select(label, id, choices, chosen, onChange) {
  const list = element('select', {id});
  for (const [value, text] of choices) {
    list.append(element('option', {value, textContent: text}));
  }
  list.value = chosen;
  list.addEventListener('change', () => onChange(list.value));
  return element('label', {className: 'wide'}, [label, list]);
}

function slider(label, id, [min, max, step, value], onInput) {
  const input = element('input', {id, type: 'range', min, max, step});
  input.value = value;
  input.addEventListener('input', () => onInput(Number(input.value)));
  return element('label', {className: 'wide'}, [label, input]);
}

function check(label, id, isOn, onChange) {
  const input = element('input', {id, type: 'checkbox', checked: isOn});
  input.addEventListener('change', () => onChange(input.checked));
  return element('label', {}, [input, label]);
}

function button(text, id, title, onClick) {
  const node = element('button', {id, type: 'button', textContent: text, title});
  node.addEventListener('click', onClick);
  return node;
}

export function showLegend(view) {
  const legend = document.getElementById('legend');
  legend.replaceChildren();
  for (const {label, max, names} of view.legends()) {
    for (const [name, color] of (names ?? []).slice(0, 12)) {
      const box = element('i');
      box.style.background = color;
      legend.append(element('span', {}, [box, element('bdi', {textContent: name})]));
    }
    if (!label) continue;
    const scale = element('i');
    scale.style.width = '90px';
    const colors = [0, 0.25, 0.5, 0.75, 1].map((x) => cssColor(sequentialColor(x)));
    scale.style.background = `linear-gradient(to right, ${colors})`;
    legend.append(element('span', {}, [`${label}: 0 `, scale, formatNumber(max, 3)]));
  }
}

// The buttons in the 3D view. `actions` has a function for each.
export function buildTools(root, actions) {
  root.append(
      button('whole', 'reset', 'show everything (r)', actions.reset),
      button('from above', 'top', 'view from above (t)', actions.top),
      button('measure', 'measure', 'distance between two cameras or points (m)',
             actions.toggleMeasure),
      button('picture', 'save_picture', 'save the view as PNG', actions.savePicture),
      button('video', 'save_video', 'save a turn about the model as WebM', actions.saveVideo),
      button('link', 'copy_link', 'copy a link to this view', actions.copyLink),
      button('full screen', 'full_screen', 'fill the screen', actions.toggleFullScreen));
}

// `loadPoints(button)` loads the points beside the page.
export function buildControls(root, data, view, loadPoints) {
  const {options} = view;
  const {arrays} = data;
  const change = (key) => (value) => {
    options[key] = value;
    view.requestRender();
  };
  const recolor = (key) => (value) => {
    options[key] = value;
    view.recolor();
    showLegend(view);
  };
  const cameraColors = [['camera', 'camera'], ['error', 'reprojection error'],
                        ['points', 'points'], ['time', 'time']];
  if (arrays.frame_confidence) cameraColors.push(['confidence', 'confidence']);
  if (arrays.truth_center) cameraColors.push(['truth', 'error against the truth']);
  if (arrays.measured_center) cameraColors.push(['measured', 'distance to measured positions']);
  if (arrays.other_center) cameraColors.push(['other', 'difference to the other model']);
  root.append(
      select('cameras by', 'camera_color', cameraColors, options.cameraColor,
             recolor('cameraColor')),
      select('points by', 'point_color',
             [...(view.hasColors ? [['color', 'color']] : []), ['height', 'height'],
              ['error', 'reprojection error'], ['length', 'track length']],
             options.pointColor, recolor('pointColor')),
      slider('point size', 'point_size', [1, 8, 0.5, options.pointSize], change('pointSize')),
      slider('camera size', 'camera_size', [-1.5, 1.5, 0.1, Math.log10(options.cameraSize)],
             (value) => change('cameraSize')(10 ** value)),
      check('follow the rig', 'follow', options.follow, (value) => {
        options.follow = value;
        view.setFrame(view.currentFrame);
      }),
      check('cameras', 'show_cameras', options.showCameras, change('showCameras')),
      check('points', 'show_points', options.showPoints, change('showPoints')),
      check('path', 'show_path', options.showPath, change('showPath')),
      check('grid', 'show_grid', options.showGrid, change('showGrid')));
  if (arrays.truth_center) {
    root.append(check('ground truth (green)', 'show_truth', options.showTruth, change('showTruth')));
  }
  if (arrays.measured_center) {
    root.append(check('measured path (orange)', 'show_measured', options.showMeasured,
                      change('showMeasured')));
  }
  if (arrays.other_center) {
    root.append(check('other model (violet)', 'show_other', options.showOther, change('showOther')));
  }
  if (data.header.side_points) {
    const {num_points: numPoints} = data.header.side_points;
    const load = button(`load all ${count(numPoints)} points`, 'load_points',
                        'from the files beside this page', () => loadPoints(load));
    root.append(load);
  }
  root.append(element('div', {id: 'legend'}));
  showLegend(view);
}
