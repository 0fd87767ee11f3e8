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
  return [element('p', {class: 'kind'}, 'Calibration report'), box, matrix(numbers),
    element('p', {class: 'remark'}, 'Sigmas take the robot’s errors as independent from stop to stop. An arm’s are smooth: take no place as known better than the arm is accurate. The error in views that no solver saw counts more than any residual.')];
}

/** One line for each measure, one column for each camera. */
function matrix(numbers) {
  const cameras = [...new Set(numbers.map((row) => row.of))];
  const measures = [...new Set(numbers.map((row) => row.what))];
  const head = element('tr', {}, element('th', {}, ''), ...cameras.map((name) => element('th', {class: 'number'}, name)), element('th', {}, 'good is'));
  const body = measures.map((what) => {
    const rows = numbers.filter((row) => row.what === what);
    const cells = cameras.map((name) => {
      const row = rows.find((entry) => entry.of === name);
      if (!row) return element('td', {class: 'number'}, '–');
      return element('td', {class: row.within ? 'number within' : 'number beyond'},
        `${row.value ?? 'unknown'} ${row.unit} ${row.within ? '✓' : '✗'}`);
    });
    return element('tr', {}, element('td', {}, what), ...cells, element('td', {class: 'soft'}, rows[0].good));
  });
  return element('div', {class: 'scroll'}, element('table', {class: 'matrix'}, element('thead', {}, head), element('tbody', {}, ...body)));
}

function nextSteps() {
  return [element('h3', {}, 'What to do next'), element('ol', {}, ...data.next_steps.map((step) => element('li', {}, step)))];
}

function contents() {
  const link = (id, text) => element('a', {href: `#${id}`}, text);
  return element('nav', {}, link('cell', 'the cell'), ...data.cameras.map((camera, i) => link(`camera-${i}`, `camera ${camera.name}`)),
    data.joint ? link('joint', 'everything at once') : null,
    data.timeline.drives.length ? link('run', 'the run') : null, link('provenance', 'provenance'));
}

function rejected(views) {
  const out = views.filter((view) => !view.used);
  if (!out.length) return element('p', {}, 'No view was left out.');
  return element('details', {}, element('summary', {}, `${out.length} of ${views.length} views were left out, and why`),
    table([['view', (view) => `${view.id} ${view.name}`], ['px RMS', (view) => view.rms_px ?? '', true], ['cause', (view) => view.cause], ['reason', (view) => view.reason]], out));
}

function streamSection(camera, stream) {
  const parts = [element('h3', {}, `${camera.name}, ${stream.stream} lens (${stream.width_px} × ${stream.height_px} px, ${stream.lens})`)];
  const figures = [figure('Parameters', 'sigmas far below what they stand beside; a distortion no larger than its sigma is not there.',
    table([['', (row) => row.name], ['value ± 1 sigma', (row) => plusMinus(row.value, row.sigma, row.unit), true]], stream.parameters))];
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
    element('p', {}, `Residual ${eye.rms_px} px with the robot corrected by ${eye.robot_correction_mm} mm and ${eye.robot_correction_deg} deg RMS; if the robot is believed, the board scatters by ${eye.scatter_mm} mm and ${eye.scatter_deg} deg. A residual is fit, not accuracy.`)];
  parts.push(grid(
    figure('Camera and board', 'sigmas of a fraction of a millimeter and of a hundredth of a degree.', poseTable([...poseRows('color camera', eye.camera), ...poseRows('board', eye.board)])),
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
  if (camera.overlay?.pictures) figures.push(overlayPictures(camera.overlay.pictures));
  if (camera.overlay) figures.push(overlayFigure(camera.overlay));
  if (depth.correction.length) figures.push(chart('The correction over the image', 'smooth, without steps between neighbors.', charts.depthCorrection(depth)));
  return [element('h3', {}, `${camera.name}: depth (${depth.sensor.replaceAll('_', ' ')})`),
    element('p', {}, `Solved from ${depth.patches} patches in ${depth.views} views, ${depth.near_m} to ${depth.far_m} m; beyond, it extrapolates.`),
    table([['at', (row) => `${row.at_m} m`], ['correction known to (1 sigma)', (row) => `${row.sigma_mm} mm`, true]], depth.sigma),
    ...depth.notes.map((note) => element('p', {}, note)), grid(...figures)];
}

/** Color, infrared and depth of one view in one picture each, over the whole image. */
function overlayPictures({before, after}) {
  const picture = (source, title) => element('figure', {}, element('img', {src: source, alt: title}), element('figcaption', {}, title));
  return figure('Color, infrared and depth over each other',
    'in the right picture the board (in a real cell: everything) has no red or cyan fringes, and yellow runs along its rim. Blue and green: color. Red: infrared, carried over by its depth. Yellow: jumps of the depth. Dark: no depth there. A simulated cell’s wall and arm are not the same for both cameras.',
    element('div', {class: 'pair'}, picture(before, 'before: by the data sheets, both cameras in one place'), picture(after, 'after: by the result')), true);
}

function overlayFigure(shown) {
  const before = shown.rms_before_px === undefined ? '' : `${shown.rms_before_px} px RMS before, `;
  return chart(`Depth on color, one view of ${shown.views}: ${before}${shown.rms_after_px} px after`,
    'every blue cross sits in its black circle; “before” is what the data sheets say, lenses without distortion in one place.', charts.overlay(shown));
}

function jointSection() {
  const joint = data.joint;
  if (!joint) return data.joint_problem ? [element('h2', {id: 'joint'}, 'Everything at once'), element('p', {}, data.joint_problem)] : [];
  const list = (title, sentences) => (sentences.length ? [element('h3', {}, title), element('ul', {}, ...sentences.map((text) => element('li', {}, text)))] : []);
  const name = (row) => `${row.camera} ${row.stream}`;
  const parts = [element('h2', {id: 'joint'}, 'Everything at once'), element('p', {}, joint.model),
    table([['', name], ['views', (row) => row.views, true], ['residual, px', (row) => row.rms_px, true], ['place ±, mm', (row) => row.place_sigma_mm, true],
      ['direction ±, deg', (row) => row.direction_sigma_deg, true], ['worst pixel ±, px', (row) => row.at_range.worst_px, true],
      ['points of the workspace ±, mm', (row) => `${row.workspace_rms_mm}, worst ${row.workspace_worst_mm}`, true],
      ['halves differ (claimed), px', (row) => (row.halves ? `${row.halves.rms_px} (${row.halves.claimed_px})` : '–'), true]], joint.cameras),
    element('p', {class: 'remark'}, 'Halves: the estimate from every other stop against that from the rest. Good is no more than is claimed; far more says that lens, board or arm are described wrongly, which no residual shows.')];
  if (joint.pairs.length) {
    parts.push(table([['one beside the other', (row) => `${row.first}, ${row.second}`], ['apart, mm', (row) => row.apart_mm, true],
      ['place ±, mm', (row) => row.place_sigma_mm, true], ['direction ±, deg', (row) => row.direction_sigma_deg, true],
      ['a point of the workspace in both ±, mm', (row) => (row.seen ? `${row.rms_mm}, worst ${row.worst_mm}` : '–'), true]], joint.pairs));
  }
  if (joint.goals) {
    parts.push(element('p', {}, `Views were chosen by information, until every pixel is known to ${joint.goals.worst_px} px and every point of the workspace to ${joint.goals.workspace_worst_mm} mm, in at most ${joint.goals.max_views} stops and ${joint.goals.max_time_s} s.`));
  }
  const {robot, board, held_out: held} = joint;
  const facts = [`The robot's noise per stop is estimated as ${robot.sigma_mm} mm and ${robot.sigma_deg} deg per axis; declared are ${robot.declared_sigma_mm} mm and ${robot.declared_sigma_deg} deg.`,
    `The print is ${board.scale_x} by ${board.scale_y} times its description, bowed by ${board.bow_x_mm} and ${board.bow_y_mm} mm.`];
  if (held) facts.push(`${held.views} views that no solver saw are off by ${held.rms_mm} mm and ${held.rms_px} px RMS, ${held.z} times what was claimed. Good is about 1; well above, the claims are too small.`);
  for (const term of robot.terms) facts.push(`The arm: ${term.name} ${term.value}.`);
  parts.push(element('ul', {}, ...facts.map((fact) => element('li', {}, fact))));
  parts.push(grid(...joint.cameras.filter((camera) => camera.at_range.sigma_px.length).map((camera) =>
    chart(`${name(camera)}: projection of a point of the cell, ${camera.range_m} m away`, 'dark and even to the corners, below the goal in the cell file.', charts.jointMap(camera, camera.at_range)))));
  parts.push(...list('Who is to blame for what does not fit', joint.faults), ...list('What the data leave open', joint.open), ...list('Notes', joint.notes));
  return parts;
}

function cameraSection(camera, index) {
  const parts = [element('h2', {id: `camera-${index}`}, `Camera ${camera.name}`)];
  if (camera.hand_eye) parts.push(...handEyeSection(camera));
  for (const stream of camera.streams) parts.push(...streamSection(camera, stream));
  if (camera.color_infrared) parts.push(...pairSection(camera.color_infrared));
  if (camera.depth) parts.push(...depthSection(camera));
  const facts = [...camera.notes];
  if (camera.held_out) facts.push(`${camera.held_out.views} views that no solver saw are off by ${camera.held_out.rms_mm} mm and ${camera.held_out.rms_px} px RMS, the robot’s own error included.`);
  if (camera.board_scale) facts.push(`By the robot's motion the board is ${plusMinus(camera.board_scale.scale, camera.board_scale.sigma)} times its stated size.`);
  if (camera.time_offset_ms !== undefined) facts.push(`Its images are stamped ${plusMinus(camera.time_offset_ms, camera.time_offset_sigma_ms, 'ms')} after the robot's.`);
  if (camera.affine_baseline) facts.push(`For comparison, the 2016 paper's affine eye-to-hand from corner depths: ${camera.affine_baseline.rms_mm} mm RMS over ${camera.affine_baseline.inliers} of ${camera.affine_baseline.points} points.`);
  if (facts.length) parts.push(element('ul', {}, ...facts.map((fact) => element('li', {}, fact))));
  return parts;
}

function pairSection(pair) {
  return [element('h3', {}, `${pair.second} beside ${pair.first}`),
    grid(figure('Pose', 'a sigma far below what the two are used for.', poseTable(poseRows(pair.second, pair.pose))), chart('Residual of both per view', 'bars of like height; red ones were left out, hover for the reason.', charts.perView(pair.views)))];
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
    'cameras where they are in the room, boards all over each camera’s view at two distances, ellipsoids round and small. The arm is drawn through its joints’ axes. Drag to turn.', element('div', {}, canvas, legend, zoom('nearer', 0.8), ' ', zoom('farther', 1.25)), true));
  waiting.push(async () => {
    if (!showScene(canvas, scene)) canvas.replaceWith(element('p', {}, 'This browser has no WebGL; the cell is not drawn.'));
  });
  return parts;
}

function runSection() {
  const {drives, log} = data.timeline;
  if (!drives.length && !log.length) return [];
  const failed = drives.filter((drive) => drive.status !== 'reached');
  const breaks = log.filter((line) => charts.kBreaks.includes(line.kind));
  return [element('h2', {id: 'run'}, 'The run'),
    element('p', {}, breaks.length ? 'The run was not of one piece:' : 'Nothing stopped the run before its end.'),
    breaks.length ? element('ul', {class: 'breaks'}, ...breaks.map((line) => element('li', {}, element('b', {}, `${line.at_s.toFixed(1)} s, ${line.kind}: `), line.text))) : null,
    grid(chart('Timeline: stages (pale), drives, and what the log says', 'drives mostly green, without long gaps; no line across, which is where the run was stopped, failed or went on. Hover for reasons, or see the lists below.', charts.timeline(data.timeline), {wide: true})),
    element('details', {}, element('summary', {}, `${failed.length} of ${drives.length} drives did not reach their goal`),
      table([['s', (row) => row.start_s, true], ['stage', (row) => row.stage], ['camera', (row) => row.camera], ['ended', (row) => row.status], ['reason', (row) => row.reason]], failed)),
    log.length ? element('details', {}, element('summary', {}, `${log.length} lines of the log`),
      table([['s', (row) => row.at_s, true], ['', (row) => row.kind], ['', (row) => row.text]], log)) : null];
}

function provenanceSection() {
  const {cell_file: cell, ...facts} = data.provenance;
  const rows = Object.entries(facts).map(([key, value]) => ({key: key.replaceAll('_', ' ').replace(/ s$/, ', s'), value}));
  return [element('h2', {id: 'provenance'}, 'Provenance'), table([['', (row) => row.key], ['', (row) => row.value]], rows),
    cell ? element('details', {}, element('summary', {}, 'cell file'), element('pre', {}, cell)) : null];
}

async function show() {
  const page = document.getElementById('report');
  page.replaceChildren(...[...verdict(), ...nextSteps(), contents(), ...cellSection(),
    ...data.cameras.flatMap(cameraSection), ...data.pairs.flatMap(pairSection), ...jointSection(), ...runSection(), ...provenanceSection()].filter((part) => part));
  for (const draw of waiting) await draw();  // one after the other: the page shows while it fills
  document.documentElement.dataset.drawn = String(waiting.length);
}

show();
