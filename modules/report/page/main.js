// SPDX-License-Identifier: GPL-3.0-or-later
// Puts the page together: verdict first, then every camera, the cell, the run, where it all comes from.
import embed from 'vega-embed';
import * as charts from './charts.js';
import {element, plusMinus, table} from './dom.js';
import {ellipsoidScale, kStageColors, showScene, stagesOf} from './scene.js';

const data = JSON.parse(document.getElementById('data').textContent);
const waiting = [];

/** A chart under its title and the one line that says what good looks like. */
function chart(title, good, specification, {wide = false, many = false} = {}) {
  const place = element('div', {class: 'chart'});
  waiting.push(() => embed(place, specification, {actions: false, renderer: many ? 'canvas' : 'svg'}));
  return figure(title, good, place, wide);
}

function figure(title, good, content, wide = false) {
  return element('figure', wide ? {class: 'wide'} : {}, element('h4', {}, title),
    element('figcaption', {}, element('b', {}, 'Good looks like: '), good), content);
}

function grid(...figures) {
  return element('div', {class: 'grid'}, ...figures.filter((entry) => entry));
}

function verdict() {
  const {goal_met: met, missing, numbers} = data.verdict;
  const box = element('div', {class: met ? 'verdict met' : 'verdict'}, element('strong', {}, met ? 'Goal met' : 'Goal not met'));
  if (missing.length) box.append(element('ul', {}, ...missing.map((text) => element('li', {}, text))));
  return [element('h1', {}, 'Calibration report'), box,
    table([['', (row) => row.what], ['value', (row) => `${row.value ?? 'unknown'} ${row.unit}`, true],
      ['good is', (row) => row.good], ['', (row) => (row.within ? '✓' : '✗ look into it')]], numbers)];
}

function nextSteps() {
  return [element('h3', {}, 'What to do next'), element('ol', {}, ...data.next_steps.map((step) => element('li', {}, step)))];
}

function contents() {
  const link = (id, text) => element('a', {href: `#${id}`}, text);
  return element('nav', {}, ...data.cameras.map((camera, i) => link(`camera-${i}`, camera.name)), link('cell', 'the cell'),
    data.timeline.length ? link('run', 'the run') : null, link('provenance', 'provenance'));
}

function rejected(views) {
  const out = views.filter((view) => !view.used);
  if (!out.length) return element('p', {}, 'No view was left out.');
  return element('details', {}, element('summary', {}, `${out.length} of ${views.length} views were left out, and why`),
    table([['view', (view) => `${view.id} ${view.name}`], ['px RMS', (view) => view.rms_px ?? '', true], ['cause', (view) => view.cause], ['reason', (view) => view.reason]], out));
}

function streamSection(camera, stream) {
  const parts = [element('h3', {}, `${camera.name}, ${stream.stream} lens (${stream.width_px} × ${stream.height_px} px, ${stream.lens})`)];
  parts.push(table([['parameter', (row) => row.name], ['value ± 1 sigma', (row) => plusMinus(row.value, row.sigma, row.unit), true]], stream.parameters));
  const figures = [];
  if (stream.coverage) {
    figures.push(chart('Coverage: corners seen per image cell', `no open cell; each holds ${stream.coverage.corners_to_fill} corners or is out of the arm's reach.`, charts.coverage(stream)));
    figures.push(chart('Kinds of views', 'every kind of distance and tilt has views.', charts.viewKinds(stream)));
  }
  if (stream.tilt_limits.length) {
    figures.push(chart('Tilt limits: how far the board was still seen', 'beyond 30 degrees each way, ended by detection or cap; "reach" is the arm’s limit, not the camera’s.', charts.tiltLimits(stream.tilt_limits)));
  }
  if (stream.residuals.u.length) {
    const scale = charts.residualScale(stream);
    figures.push(chart(`Residual vectors, drawn ${scale} times as long`, 'short arrows without pattern, to the image’s corners; a swirl or a star is a lens the model cannot follow.', charts.residualVectors(stream), {many: true}));
    figures.push(chart('Residual directions', 'confetti: no region of one color (0 degrees: right, 90: down).', charts.residualDirections(stream), {many: true}));
    figures.push(chart('Residuals together', 'one round cloud centred on zero.', charts.residualCloud(stream), {many: true}));
  }
  if (stream.views.length) figures.push(chart('Residual per view', 'bars of like height; red ones were left out, hover for the reason.', charts.perView(stream.views)));
  if (stream.uncertainty.length) {
    figures.push(chart('Projection uncertainty of a far point', 'dark and even to the corners; a bright rim says no view reached there.', charts.uncertainty(stream)));
  }
  parts.push(grid(...figures));
  if (stream.views.length) parts.push(rejected(stream.views));
  return parts;
}

function poseRows(name, pose) {
  const axes = ['x', 'y', 'z'];
  return axes.map((axis, i) => ({
    what: i ? '' : `${name} in ${pose.parent}`, axis,
    place: plusMinus(pose.translation_mm[i], pose.translation_sigma_mm[i], 'mm'),
    turn: plusMinus(pose.rotation_vector_deg[i], pose.rotation_sigma_deg[i], 'deg')}));
}

function poseTable(rows) {
  return table([['', (row) => row.what], ['axis', (row) => row.axis], ['place', (row) => row.place, true], ['rotation vector', (row) => row.turn, true]], rows);
}

function handEyeSection(camera) {
  const eye = camera.hand_eye;
  const parts = [element('h3', {}, `${camera.name}: where it stands`),
    poseTable([...poseRows('color camera', eye.camera), ...poseRows('board', eye.board)]),
    element('p', {}, `Residual ${eye.rms_px} px with the robot corrected by ${eye.robot_correction_mm} mm and ${eye.robot_correction_deg} deg RMS; if the robot is believed, the board scatters by ${eye.scatter_mm} mm and ${eye.scatter_deg} deg. A residual is fit, not accuracy.`)];
  parts.push(grid(
    eye.steps.length > 1 ? chart('Hand-eye against number of views', 'the red line falls with the blue one and stays near or below it.', charts.handEyeSteps(eye.steps)) : null,
    chart('Hand-eye residual per view', 'bars of like height; red ones were left out, hover for the reason.', charts.perView(eye.views))));
  parts.push(rejected(eye.views));
  return parts;
}

function depthSection(camera) {
  const depth = camera.depth;
  const infrared = camera.streams.find((stream) => stream.stream === 'infrared');
  const figures = [chart('Depth error before and after', 'the blue bar is a fraction of the red one.', charts.depthSummary(depth))];
  if (depth.samples.length) {
    figures.push(chart('Depth error over range', 'blue lies along zero without slope or wave.', charts.depthOverRange(depth), {many: true}));
    if (infrared) {
      figures.push(chart('Depth error over the image, as delivered', 'not expected to be good: this is what is corrected.', charts.depthOverImage(depth, infrared, 'before_mm'), {many: true}));
      figures.push(chart('Depth error over the image, corrected', 'pale everywhere; a colored region is a shape the correction misses.', charts.depthOverImage(depth, infrared, 'after_mm'), {many: true}));
    }
  }
  if (depth.correction.length) figures.push(chart('The correction over the image', 'smooth, without steps between neighbors.', charts.depthCorrection(depth)));
  return [element('h3', {}, `${camera.name}: depth (${depth.sensor.replaceAll('_', ' ')})`),
    element('p', {}, `Solved from ${depth.patches} patches in ${depth.views} views, ${depth.near_m} to ${depth.far_m} m; beyond, it extrapolates.`),
    table([['at', (row) => `${row.at_m} m`], ['correction known to (1 sigma)', (row) => `${row.sigma_mm} mm`, true]], depth.sigma),
    ...depth.notes.map((note) => element('p', {}, note)), grid(...figures)];
}

function cameraSection(camera, index) {
  const parts = [element('h2', {id: `camera-${index}`}, `Camera ${camera.name}`)];
  if (camera.hand_eye) parts.push(...handEyeSection(camera));
  for (const stream of camera.streams) parts.push(...streamSection(camera, stream));
  if (camera.color_infrared) parts.push(...pairSection(camera.color_infrared));
  if (camera.depth) parts.push(...depthSection(camera));
  const facts = [...camera.notes];
  if (camera.board_scale) facts.push(`By the robot's motion the board is ${plusMinus(camera.board_scale.scale, camera.board_scale.sigma)} times its stated size.`);
  if (camera.time_offset_ms !== undefined) facts.push(`Its images are stamped ${plusMinus(camera.time_offset_ms, camera.time_offset_sigma_ms, 'ms')} after the robot's.`);
  if (camera.affine_baseline) facts.push(`For comparison, the 2016 paper's affine eye-to-hand from corner depths: ${camera.affine_baseline.rms_mm} mm RMS over ${camera.affine_baseline.inliers} of ${camera.affine_baseline.points} points.`);
  if (facts.length) parts.push(element('ul', {}, ...facts.map((fact) => element('li', {}, fact))));
  return parts;
}

function pairSection(pair) {
  return [element('h3', {}, `${pair.second} beside ${pair.first}`), poseTable(poseRows(pair.second, pair.pose)),
    grid(chart('Residual of both per view', 'bars of like height; red ones were left out, hover for the reason.', charts.perView(pair.views)))];
}

function cellSection() {
  const scene = data.scene;
  const parts = [element('h2', {id: 'cell'}, 'The cell')];
  if (!scene.cameras.length && !scene.moving.length) return [...parts, element('p', {}, 'No camera stands on the robot in this result.')];
  const canvas = element('canvas', {class: 'scene', 'aria-label': 'the cell in 3D'});
  const scale = ellipsoidScale(scene);
  const legend = element('p', {class: 'legend'}, ...stagesOf(scene).map((stage, i) =>
    element('span', {}, element('i', {class: 'swatch', style: `background:${kStageColors[i % kStageColors.length]}`}), stage)));
  const zoom = (text, factor) => {
    const button = element('button', {type: 'button'}, text);
    button.addEventListener('click', () => canvas.zoom?.(factor));
    return button;
  };
  parts.push(figure(`Robot base, cameras${scale ? `, their uncertainty (red, 1 sigma drawn ${scale} times as large)` : ''} and where the board has been`,
    'cameras where they are in the room, boards all over each camera’s view at two distances, ellipsoids round and small. Drag to turn.', element('div', {}, canvas, legend, zoom('nearer', 0.8), ' ', zoom('farther', 1.25)), true));
  waiting.push(async () => {
    if (!showScene(canvas, scene)) canvas.replaceWith(element('p', {}, 'This browser has no WebGL; the cell is not drawn.'));
  });
  return parts;
}

function runSection() {
  if (!data.timeline.length) return [];
  const stops = data.timeline.filter((attempt) => attempt.status !== 'reached');
  return [element('h2', {id: 'run'}, 'The run'),
    grid(chart('Timeline of drives', 'mostly green, without long gaps; every other color has its reason, hover for it.', charts.timeline(data.timeline), {wide: true})),
    element('details', {}, element('summary', {}, `${stops.length} of ${data.timeline.length} drives did not reach their goal`),
      table([['s', (row) => row.start_s, true], ['stage', (row) => row.stage], ['camera', (row) => row.camera], ['ended', (row) => row.status], ['reason', (row) => row.reason]], stops))];
}

function provenanceSection() {
  const {cell_file: cell, ...facts} = data.provenance;
  const rows = Object.entries(facts).map(([key, value]) => ({key: key.replaceAll('_', ' ').replace(/ s$/, ', s'), value}));
  return [element('h2', {id: 'provenance'}, 'Provenance'), table([['', (row) => row.key], ['', (row) => row.value]], rows),
    cell ? element('details', {}, element('summary', {}, 'cell file'), element('pre', {}, cell)) : null];
}

async function show() {
  const page = document.getElementById('report');
  page.replaceChildren(...[...verdict(), ...nextSteps(), contents(), ...data.cameras.flatMap(cameraSection),
    ...data.pairs.flatMap(pairSection), ...cellSection(), ...runSection(), ...provenanceSection()].filter((part) => part));
  for (const draw of waiting) await draw();  // one after the other: the page shows while it fills
  document.documentElement.dataset.drawn = String(waiting.length);
}

show();
