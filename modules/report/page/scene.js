// SPDX-License-Identifier: GPL-3.0-or-later
// The cell in 3D: robot base, cameras, their uncertainty, and where the board (or the camera) has been.
import * as THREE from 'three';
import {OrbitControls} from 'three/addons/controls/OrbitControls.js';

export const kStageColors = ['#31688e', '#7fc8a0', '#f0a35e', '#8d7cc3', '#d1495b', '#5a6572'];

export function stagesOf(scene) {
  return [...new Set(scene.moving.map((pose) => pose.stage))];
}

/** Ellipsoids are drawn this much larger, so that the largest can be seen. */
export function ellipsoidScale(scene) {
  const largest = Math.max(0, ...scene.cameras.flatMap((camera) => camera.sigma_m ?? []));
  if (!(largest > 0)) return 0;
  return Math.max(1, 10 ** Math.floor(Math.log10(0.08 / largest)));
}

function lines(points, color, opacity = 1) {
  const geometry = new THREE.BufferGeometry().setFromPoints(points);
  return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({color, transparent: opacity < 1, opacity}));
}

function loop(corners) {
  return corners.flatMap((corner, i) => [corner, corners[(i + 1) % corners.length]]);
}

function placed(pose, points) {
  const matrix = new THREE.Matrix4().fromArray(pose);
  return points.map((point) => point.clone().applyMatrix4(matrix));
}

function label(text, size) {
  const canvas = document.createElement('canvas');
  const context = canvas.getContext('2d');
  context.font = '48px system-ui, sans-serif';
  canvas.width = Math.ceil(context.measureText(text).width) + 8;
  canvas.height = 60;
  context.font = '48px system-ui, sans-serif';
  context.fillStyle = '#1c2127';
  context.fillText(text, 4, 46);
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({map: new THREE.CanvasTexture(canvas), depthTest: false}));
  sprite.scale.set((size * canvas.width) / canvas.height, size, 1);
  return sprite;
}

const vectors = (list) => list.map((entry) => new THREE.Vector3(...entry));
const kOrigin = new THREE.Vector3();

function frustumLines(corners) {
  return [...loop(corners), ...corners.flatMap((corner) => [kOrigin, corner])];
}

/** A link of the arm as a rod. */
function rod(from, to, radius, opacity) {
  const along = new THREE.Vector3().subVectors(to, from);
  const made = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, along.length(), 14),
    new THREE.MeshLambertMaterial({color: '#9aa9b8', transparent: opacity < 1, opacity, depthWrite: opacity === 1}));
  made.position.copy(from).addScaledVector(along, 0.5);
  made.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.normalize());
  return made;
}

function arm(points, first) {
  const radius = first ? 0.032 : 0.02, opacity = first ? 1 : 0.16;
  const joints = points.map((point) => {
    const ball = new THREE.Mesh(new THREE.SphereGeometry(radius * 1.25, 18, 12),
      new THREE.MeshLambertMaterial({color: '#5d84aa', transparent: !first, opacity, depthWrite: first}));
    ball.position.copy(point);
    return ball;
  });
  return [...joints, ...points.slice(1).map((point, i) => rod(points[i], point, radius, opacity))];
}

/** The sides of a camera's view, so that it reads as a solid. */
function view(corners, pose) {
  const at = placed(pose, [kOrigin, ...corners]);
  const geometry = new THREE.BufferGeometry().setFromPoints([[1, 2], [2, 3], [3, 4], [4, 1]].flatMap(([a, b]) => [at[0], at[a], at[b]]));
  return new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({color: '#31688e', transparent: true, opacity: 0.18, side: THREE.DoubleSide, depthWrite: false}));
}

function build(data) {
  const world = new THREE.Scene();
  world.background = new THREE.Color('#ffffff');
  world.up.set(0, 0, 1);
  const bounds = new THREE.Box3().expandByPoint(kOrigin);
  const add = (points, color, opacity = 1) => {
    if (points.length === 0) return;
    world.add(lines(points, color, opacity));
    points.forEach((point) => bounds.expandByPoint(point));
  };
  const outline = vectors(data.board_outline_m);
  const scale = ellipsoidScale(data);
  for (const camera of data.cameras) {
    add(placed(camera.pose, frustumLines(vectors(camera.frustum_m))), camera.sigma_m ? '#1c2127' : '#8a94a0');
    if (!camera.sigma_m) continue;
    world.add(view(vectors(camera.frustum_m), camera.pose));
    const centre = placed(camera.pose, [kOrigin])[0];
    const ball = new THREE.Mesh(new THREE.SphereGeometry(1, 24, 16),
      new THREE.MeshBasicMaterial({color: '#d1495b', transparent: true, opacity: 0.35}));
    ball.position.copy(centre);
    ball.scale.set(...camera.sigma_m.map((sigma) => Math.max(1e-4, sigma * scale)));
    world.add(ball);
    const name = label(camera.name.replace(/ color$/, ''), 0.055);
    name.position.copy(centre).add(new THREE.Vector3(0, 0, 0.08));
    world.add(name);
  }
  stagesOf(data).forEach((stage, index) => {
    const points = data.moving.filter((pose) => pose.stage === stage).flatMap((pose) =>
      placed(pose.pose, pose.kind === 'board' ? loop(outline) : frustumLines(vectors([[-0.03, -0.02, 0.06], [0.03, -0.02, 0.06], [0.03, 0.02, 0.06], [-0.03, 0.02, 0.06]]))));
    add(points, kStageColors[index % kStageColors.length], 0.5);
  });
  world.add(new THREE.AmbientLight('#ffffff', 1.6));
  const sun = new THREE.DirectionalLight('#ffffff', 2.2);
  sun.position.set(2, -3, 4);
  world.add(sun);
  (data.arms ?? []).forEach((points, i) => {
    world.add(...arm(vectors(points), i === 0));
    vectors(points).forEach((point) => bounds.expandByPoint(point));
  });
  if (data.board) add(placed(data.board, loop(outline)), '#1c2127');
  world.add(new THREE.AxesHelper(0.2));
  const base = label('base', 0.05);
  base.position.set(0.03, 0.03, 0.05);
  world.add(base);
  const size = bounds.getSize(new THREE.Vector3()).length();
  const grid = new THREE.GridHelper(Math.ceil(size), Math.ceil(size) * 5, '#c7ced5', '#e6eaee');
  grid.rotation.x = Math.PI / 2;
  world.add(grid);
  return {world, bounds};
}

/** Draws into a canvas; still until it is turned. Returns false where the browser has no WebGL. */
export function showScene(canvas, data) {
  if (!document.createElement('canvas').getContext('webgl2')) return false;
  const {world, bounds} = build(data);
  const renderer = new THREE.WebGLRenderer({canvas, antialias: true, preserveDrawingBuffer: true});
  const eye = new THREE.PerspectiveCamera(45, 1, 0.01, 100);
  eye.up.set(0, 0, 1);
  const centre = bounds.getCenter(new THREE.Vector3());
  const narrow = Math.max(1, (1.5 * canvas.clientHeight) / Math.max(1, canvas.clientWidth));  // a phone's
  const distance = 0.8 * narrow * bounds.getSize(new THREE.Vector3()).length();
  eye.position.copy(centre).add(new THREE.Vector3(0.65, -0.65, 0.45).multiplyScalar(distance));
  const controls = new OrbitControls(eye, canvas);
  controls.target.copy(centre);
  controls.enableZoom = false;  // the wheel scrolls the page; buttons zoom
  controls.update();
  const draw = () => {
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    renderer.setSize(width, height, false);
    eye.aspect = width / height;
    eye.updateProjectionMatrix();
    renderer.render(world, eye);
  };
  controls.addEventListener('change', draw);
  new ResizeObserver(draw).observe(canvas);
  draw();
  canvas.zoom = (factor) => {
    eye.position.sub(controls.target).multiplyScalar(factor).add(controls.target);
    controls.update();
    draw();
  };
  return true;
}
