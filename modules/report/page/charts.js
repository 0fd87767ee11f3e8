// SPDX-License-Identifier: GPL-3.0-or-later
// Every chart as a Vega-Lite specification of the report's data.

const kConfig = {
  font: 'system-ui, sans-serif',
  view: {stroke: '#dde2e7'},
  axis: {labelFontSize: 11, titleFontSize: 12, titleFontWeight: 'normal', gridColor: '#eceff2'},
  legend: {labelFontSize: 11, titleFontSize: 12, titleFontWeight: 'normal', orient: 'bottom', columns: 2,
    layout: {bottom: {direction: 'vertical', anchor: 'start'}}},
};
const kUsedColors = {domain: ['used', 'left out'], range: ['#31688e', '#d1495b']};

function spec(values, rest) {
  return {
    $schema: 'https://vega.github.io/schema/vega-lite/v6.json',
    width: 'container',
    height: 215,
    autosize: {type: 'fit-x', contains: 'padding'},
    config: kConfig,
    data: {values},
    ...rest,
  };
}

/** Axes of the image: v downward. */
function imageAxes(stream, u = 'u', v = 'v') {
  return {
    x: {field: u, type: 'quantitative', title: 'u, px', scale: {domain: [0, stream.width_px], nice: false}},
    y: {field: v, type: 'quantitative', title: 'v, px', scale: {domain: [stream.height_px, 0], nice: false}},
  };
}

function residualRows(stream) {
  const {view, u, v, du, dv} = stream.residuals;
  return view.map((id, i) => ({view: id, u: u[i], v: v[i], du: du[i], dv: dv[i], length: Math.hypot(du[i], dv[i]),
    direction: (Math.atan2(dv[i], du[i]) * 180) / Math.PI}));
}

/** Arrows are readable if the typical one is a fortieth of the image. */
export function residualScale(stream) {
  const rms = Math.sqrt(residualRows(stream).reduce((sum, row) => sum + row.length ** 2, 0) /
    Math.max(1, stream.residuals.u.length));
  if (!(rms > 0)) return 1;
  const wanted = stream.width_px / 40 / rms;
  const decade = 10 ** Math.floor(Math.log10(wanted));
  return decade * [1, 2, 5].filter((step) => step * decade <= wanted).pop();
}

export function residualVectors(stream) {
  const scale = residualScale(stream);
  const rows = residualRows(stream).map((row) => ({...row, u2: row.u + scale * row.du, v2: row.v + scale * row.dv}));
  return spec(rows, {
    mark: {type: 'rule', strokeWidth: 1.2, clip: true, tooltip: true},
    encoding: {...imageAxes(stream), x2: {field: 'u2'}, y2: {field: 'v2'},
      color: {field: 'length', type: 'quantitative', title: 'length, px', scale: {scheme: 'viridis'}}},
  });
}

export function residualDirections(stream) {
  return spec(residualRows(stream), {
    mark: {type: 'point', filled: true, size: 26, opacity: 0.9, clip: true, tooltip: true},
    encoding: {...imageAxes(stream),
      color: {field: 'direction', type: 'quantitative', title: 'direction, deg',
        scale: {scheme: 'sinebow', domain: [-180, 180]}}},
  });
}

export function residualCloud(stream) {
  const rows = residualRows(stream);
  const reach = Math.max(0.05, ...rows.map((row) => Math.max(Math.abs(row.du), Math.abs(row.dv))));
  const axis = (field, title) => ({field, type: 'quantitative', title, scale: {domain: [-reach, reach]}});
  return spec(rows, {
    mark: {type: 'point', filled: true, size: 12, opacity: 0.4, color: '#31688e'},
    encoding: {x: axis('du', 'du, px'), y: axis('dv', 'dv, px')},
  });
}

export function perView(views) {
  const rows = views.map((view, order) => ({...view, order, label: `${view.id} ${view.name}`, fate: view.used ? 'used' : 'left out'}));
  return spec(rows, {
    mark: {type: 'bar', tooltip: true},
    encoding: {
      x: {field: 'order', type: 'ordinal', title: 'view, in the order seen', axis: {labels: false, ticks: false}},
      y: {field: 'rms_px', type: 'quantitative', title: 'residual, px RMS'},
      color: {field: 'fate', type: 'nominal', title: null, scale: kUsedColors},
      tooltip: ['label', 'rms_px', 'fate', 'cause', 'reason'].map((field) => ({field})),
    },
  });
}

export function coverage(stream) {
  const cell = {x: {field: 'x', type: 'ordinal', title: null, axis: null}, y: {field: 'y', type: 'ordinal', title: null, axis: null}};
  return spec(stream.coverage.cells, {
    encoding: cell,
    layer: [
      {mark: {type: 'rect', stroke: 'white', tooltip: true},
        encoding: {color: {field: 'state', type: 'nominal', title: 'cell',
          scale: {domain: ['filled', 'open', 'out of reach'], range: ['#7fc8a0', '#f3b0a5', '#cfd5da']}}}},
      {mark: {type: 'text', fontSize: 11}, encoding: {text: {field: 'corners'}}},
    ],
  });
}

export function viewKinds(stream) {
  return spec(stream.coverage.views, {
    height: 140,
    mark: {type: 'bar', color: '#31688e', tooltip: true},
    encoding: {y: {field: 'bin', type: 'nominal', title: null, sort: null}, x: {field: 'views', type: 'quantitative', title: 'views'}},
  });
}

/** Polar: one slice per direction of tilt, as long as the angle reached. */
export function tiltLimits(limits) {
  const around = ['pitch+', 'roll+', 'yaw+', 'pitch-', 'roll-', 'yaw-'];
  const rows = limits.map((limit) => {
    const from = around.indexOf(limit.direction);
    return {...limit, from, middle: from + 0.5, to: from + 1, label: `${limit.direction} ${Math.round(limit.limit_deg)}°`};
  });
  const turn = {type: 'quantitative', stack: null, scale: {domain: [0, around.length], range: [0, 2 * Math.PI]}};
  const radius = {field: 'limit_deg', type: 'quantitative', stack: null, scale: {type: 'linear', zero: true, rangeMin: 0, domainMax: 60}};
  return spec(rows, {
    height: 300,
    layer: [
      {mark: {type: 'arc', stroke: 'white', tooltip: true},
        encoding: {theta: {field: 'from', ...turn}, theta2: {field: 'to'}, radius,
          color: {field: 'ended_by', type: 'nominal', title: 'ended by',
            scale: {domain: ['detection', 'cap', 'reach'], range: ['#31688e', '#7fc8a0', '#f0a35e']}},
          tooltip: ['direction', 'limit_deg', 'ended_by'].map((field) => ({field}))}},
      {mark: {type: 'text', radiusOffset: -26, fontSize: 11, fill: 'white'},
        encoding: {theta: {field: 'middle', ...turn}, radius, text: {field: 'label'}}},
    ],
  });
}

/** Infrared corners with their depth, drawn into the color image: where they were, and where they are now. */
export function overlay(shown) {
  const rows = shown.corners.flatMap((corner) => [
    {u: corner.color[0], v: corner.color[1], what: 'color sees it'},
    ...(corner.before ? [{u: corner.before[0], v: corner.before[1], what: 'depth, before'}] : []),
    ...(corner.after ? [{u: corner.after[0], v: corner.after[1], what: 'depth, after'}] : [])]);
  const axis = (field, title, reverse) => ({field, type: 'quantitative', title, scale: {zero: false, nice: false, reverse, padding: 12}});
  const kinds = ['color sees it', 'depth, before', 'depth, after'];
  return spec(rows, {
    height: 260,
    mark: {type: 'point', size: 46, strokeWidth: 1.6, tooltip: true},
    encoding: {
      x: axis('u', 'u, px', false), y: axis('v', 'v, px', true),
      color: {field: 'what', type: 'nominal', title: null, scale: {domain: kinds, range: ['#1c2127', '#d1495b', '#31688e']}},
      shape: {field: 'what', type: 'nominal', title: null, scale: {domain: kinds, range: ['circle', 'triangle-up', 'cross']}},
    },
  });
}

/** A projection map of the joint estimate. */
export function jointMap(camera, map) {
  const step = {x: camera.width_px / Math.max(1, map.cells_x - 1), y: camera.height_px / Math.max(1, map.cells_y - 1)};
  const rows = map.sigma_px.map((sigma_px, i) => {
    const u = (i % map.cells_x) * step.x, v = Math.floor(i / map.cells_x) * step.y;
    return {sigma_px, left: u - step.x / 2, right: u + step.x / 2, top: v - step.y / 2, bottom: v + step.y / 2};
  });
  return spec(rows, {
    mark: {type: 'rect', clip: true, tooltip: true, strokeWidth: 0.3},
    encoding: {...imageAxes(camera, 'left', 'top'), x2: {field: 'right'}, y2: {field: 'bottom'},
      color: {field: 'sigma_px', type: 'quantitative', title: '1 sigma, px', scale: {scheme: 'viridis', zero: true}}},
  });
}

export function uncertainty(stream) {
  const us = [...new Set(stream.uncertainty.map((at) => at.u))].sort((a, b) => a - b);
  const half = us.length > 1 ? (us[1] - us[0]) / 2 : 1;
  const vs = [...new Set(stream.uncertainty.map((at) => at.v))].sort((a, b) => a - b);
  const halfDown = vs.length > 1 ? (vs[1] - vs[0]) / 2 : 1;
  const rows = stream.uncertainty.map((at) => ({...at, left: at.u - half, right: at.u + half, top: at.v - halfDown, bottom: at.v + halfDown}));
  return spec(rows, {
    mark: {type: 'rect', clip: true, tooltip: true, strokeWidth: 0.3},
    encoding: {...imageAxes(stream, 'left', 'top'), x2: {field: 'right'}, y2: {field: 'bottom'},
      color: {field: 'sigma_px', type: 'quantitative', title: '1 sigma, px', scale: {scheme: 'viridis', zero: true}}},
  });
}

export function handEyeSteps(steps) {
  const rows = steps.flatMap((step) => [
    {views: step.views, mm: Math.max(step.error_mm, 1e-3), what: 'distance to the final answer'},
    {views: step.views, mm: Math.max(step.sigma_mm, 1e-3), what: '1 sigma it claimed'}]);
  return spec(rows, {
    mark: {type: 'line', point: true, tooltip: true},
    encoding: {
      x: {field: 'views', type: 'quantitative', title: 'views used'},
      y: {field: 'mm', type: 'quantitative', title: 'mm', scale: {type: 'log'}},
      color: {field: 'what', type: 'nominal', title: null,
        scale: {domain: ['distance to the final answer', '1 sigma it claimed'], range: ['#d1495b', '#31688e']}},
    },
  });
}

export function depthOverRange(depth) {
  const rows = depth.samples.flatMap((at) => [
    {depth_m: at.depth_m, mm: at.before_mm, what: 'as delivered'}, {depth_m: at.depth_m, mm: at.after_mm, what: 'corrected'}]);
  return spec(rows, {
    mark: {type: 'point', filled: true, size: 10, opacity: 0.4},
    encoding: {
      x: {field: 'depth_m', type: 'quantitative', title: 'depth, m', scale: {zero: false}},
      y: {field: 'mm', type: 'quantitative', title: 'depth error, mm'},
      color: {field: 'what', type: 'nominal', title: null, scale: {domain: ['as delivered', 'corrected'], range: ['#d1495b', '#31688e']}},
    },
  });
}

/** Two images side by side, one scale. */
export function depthOverImage(depth, stream, field) {
  const reach = Math.max(1, ...depth.samples.map((at) => Math.abs(at.before_mm)));
  return spec(depth.samples, {
    mark: {type: 'point', filled: true, size: 30, clip: true, tooltip: true},
    encoding: {...imageAxes(stream),
      color: {field, type: 'quantitative', title: 'depth error, mm', scale: {scheme: 'redblue', domain: [reach, -reach]}}},
  });
}

export function depthSummary(depth) {
  return spec([{what: 'as delivered', mm: depth.rms_before_mm}, {what: 'corrected', mm: depth.rms_after_mm}], {
    height: 110,
    mark: {type: 'bar', tooltip: true},
    encoding: {y: {field: 'what', type: 'nominal', title: null, sort: null}, x: {field: 'mm', type: 'quantitative', title: 'depth error, mm RMS'},
      color: {field: 'what', type: 'nominal', legend: null, scale: {domain: ['as delivered', 'corrected'], range: ['#d1495b', '#31688e']}}},
  });
}

export function depthCorrection(depth) {
  const reach = Math.max(1, ...depth.correction.map((at) => Math.abs(at.correction_mm)));
  return spec(depth.correction, {
    mark: {type: 'rect', tooltip: true},
    encoding: {x: {field: 'x', type: 'ordinal', axis: null}, y: {field: 'y', type: 'ordinal', axis: null},
      color: {field: 'correction_mm', type: 'quantitative', title: `correction at ${depth.correction_at_m} m, mm`,
        scale: {scheme: 'redblue', domain: [reach, -reach]}}},
  });
}

const kLogRow = 'log';
/** What the log tells, by kind: color of its mark; those with a line across are where a run was broken off, or went on. */
export const kLogKinds = {note: '#8a94a0', arm: '#8d7cc3', resumed: '#31688e', end: '#1a7f4b', interrupted: '#f0a35e', fault: '#d1495b', lost: '#1c2127'};
const kDriveEnds = {reached: '#7fc8a0', plateau: '#c9d66b', target_lost: '#f0a35e', unreachable: '#b8c0c8', limit: '#8d7cc3', stopped: '#d1495b'};
export const kBreaks = ['resumed', 'interrupted', 'fault', 'lost'];

/** Colors of those that occur. */
function scaleOf(colors, names) {
  const domain = Object.keys(colors).filter((name) => names.includes(name));
  return {domain, range: domain.map((name) => colors[name])};
}

/** One row for each stage: pale while it lasts, its drives over it; below, what the log says. */
export function timeline({drives, stages, log}) {
  const rows = [...new Set([...stages, ...drives].map((bar) => bar.stage)), ...(log.length ? [kLogRow] : [])];
  const time = (field) => ({field, type: 'quantitative', title: 'time of the run, s', scale: {nice: false, zero: true}});
  const row = {type: 'nominal', title: null, scale: {domain: rows}};
  const kind = {field: 'kind', type: 'nominal', title: 'log', scale: scaleOf(kLogKinds, log.map((line) => line.kind))};
  const told = ['at_s', 'kind', 'text'].map((field) => ({field}));
  const lines = log.map((line) => ({...line, row: kLogRow}));
  return spec([], {
    height: 34 * rows.length,
    resolve: {scale: {color: 'independent'}},
    layer: [
      {data: {values: stages}, mark: {type: 'bar', color: '#e6eaee', height: {band: 0.92}, tooltip: true},
        encoding: {x: time('start_s'), x2: {field: 'end_s'}, y: {field: 'stage', ...row},
          tooltip: ['stage', 'of', 'start_s', 'end_s'].map((field) => ({field}))}},
      {data: {values: drives}, mark: {type: 'bar', tooltip: true, cornerRadius: 1, height: {band: 0.6}},
        encoding: {x: time('start_s'), x2: {field: 'end_s'}, y: {field: 'stage', ...row},
          color: {field: 'status', type: 'nominal', title: 'drive ended', scale: scaleOf(kDriveEnds, drives.map((bar) => bar.status))},
          tooltip: ['stage', 'camera', 'start_s', 'end_s', 'status', 'reason'].map((field) => ({field}))}},
      {data: {values: lines.filter((line) => kBreaks.includes(line.kind))}, mark: {type: 'rule', strokeWidth: 1.5},
        encoding: {x: time('at_s'), color: {...kind, legend: null}, tooltip: told}},
      {data: {values: lines}, mark: {type: 'point', filled: true, size: 46, opacity: 0.9, tooltip: true},
        encoding: {x: time('at_s'), y: {field: 'row', ...row}, color: kind, tooltip: told}},
    ].filter((layer) => layer.data.values.length),
  });
}
