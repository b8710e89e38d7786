// The arm in 3D. Frame {B_i} of joint i is a group of three.js, placed as Eq. (32)-(36) place it in {B_(i-1)}.

import { darkScheme, framesOf, inkOf, make, reducedMotion } from "./data.js";

const T = vendor;
const POSITIVE = new T.Color(inkOf("positive")), NEGATIVE = new T.Color(inkOf("negative")), NEUTRAL = new T.Color("#a3aeba"), SECOND = new T.Color("#f2b632");

/** The frames of an arm. */
export class Chain {
  constructor(arm) {
    this.types = arm.types;
    this.root = new T.Group();
    let parent = this.root;
    this.links = arm.types.map((_, i) => {
      const placed = new T.Group(), link = new T.Group();
      placed.position.set(...arm.offset[i]);
      placed.setRotationFromMatrix(turned(arm.rotation[i]));
      parent.add(placed.add(link));
      parent = link;
      return link;
    });
    this.tool = new T.Group();
    this.tool.position.set(...arm.tool_offset);
    this.tool.setRotationFromMatrix(turned(arm.tool_rotation));
    parent.add(this.tool);
  }

  set(q) {
    this.links.forEach((link, i) => {
      if (this.types[i] === "prismatic") link.position.z = q[i];
      else link.rotation.z = q[i];
    });
    this.root.updateMatrixWorld(true);
  }

  /** Position of the end effector in {I} [m]. */
  toolAt(q) {
    this.set(q);
    return new T.Vector3().setFromMatrixPosition(this.tool.matrixWorld);
  }
}

const turned = (R) => new T.Matrix4().set(...R[0], 0, ...R[1], 0, ...R[2], 0, 0, 0, 0, 1);

/** Positions, errors, torques, torsion, power and forces of a run at its frames. */
export class Motion {
  constructor(run) {
    Object.assign(this, framesOf(run)); // time, q; error, torque, torsion, .. where they are known
  }

  /** Values of all joints at a time, between frames on a straight line. */
  at(name, t) {
    const last = this.time.length - 1;
    let low = 0, high = last;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.time[middle] <= t) low = middle;
      else high = middle;
    }
    const share = high > low ? Math.min(1, Math.max(0, (t - this.time[low]) / (this.time[high] - this.time[low]))) : 0;
    return this[name].map((row) => (1 - share) * row[low] + share * row[high]);
  }

  row(name, k) {
    return this[name].map((row) => row[k]);
  }

  /** Largest absolute value of each joint. */
  peaks(name) {
    this.found ??= {};
    this.found[name] ??= this[name].map((row) => row.reduce((most, v) => Math.max(most, Math.abs(v)), 0));
    return this.found[name];
  }
}

const errors = new WeakMap();

/** Distance [mm] between desired and actual end effector at the frames: errors are added to positions in double precision. */
export function toolErrors(run) {
  const known = run.result ?? run;
  if (errors.has(known)) return errors.get(known);
  const chain = new Chain(run.arm), motion = new Motion(run);
  const values = Float64Array.from(motion.time, (_, k) => {
    const q = motion.row("q", k), error = motion.row("error", k);
    return 1e3 * chain.toolAt(q).distanceTo(chain.toolAt(q.map((v, i) => v + error[i])));
  });
  errors.set(known, { time: motion.time, values });
  return errors.get(known);
}

/** An arm in the scene: actual, desired as a ghost, and its path. */
class Puppet {
  constructor(run, tint = null) {
    const { reach } = run.arm;
    Object.assign(this, { root: new T.Group(), actual: new Chain(run.arm), desired: run.frames.error ? new Chain(run.arm) : null });
    this.path = tube(0.0045 * reach, inkOf("positive"), 1);
    this.trace = tube(0.0025 * reach, darkScheme.matches ? "#9aa7b5" : "#66717d", 0.55);
    this.follow(run);
    dress(this.actual, run.arm, solid, tint);
    if (this.desired) dress(this.desired, run.arm, ghost, tint);
    this.root.add(this.actual.root, ...(this.desired ? [this.desired.root] : []), this.path, this.trace);
  }

  /** Take over the motion of a run: its path, and the space that it needs. */
  follow(run) {
    const chain = new Chain(run.arm);
    this.motion = new Motion(run);
    this.box = new T.Box3().expandByPoint(new T.Vector3());
    const step = Math.max(1, Math.floor(this.motion.time.length / 250));
    const path = [], point = new T.Vector3(), travelled = [0];
    let before = null;
    for (let k = 0; k < this.motion.time.length; k += 1) {
      const at = chain.toolAt(this.motion.row("q", k));
      if (before) travelled.push(travelled.at(-1) + at.distanceTo(before));
      before = at;
      if (k % step === 0 || k === this.motion.time.length - 1) path.push(at);
      for (const link of k % step ? [] : chain.links) this.box.expandByPoint(point.setFromMatrixPosition(link.matrixWorld));
      this.box.expandByPoint(at);
    }
    this.motion.travelled = [travelled];
    this.path.along(path);
    this.trace.along(path);
  }

  show(t, quantity, magnify, peaks) {
    const q = this.motion.at("q", t);
    const error = this.motion.error ? this.motion.at("error", t) : null;
    this.actual.set(error ? q.map((v, i) => v - (magnify - 1) * error[i]) : q);
    this.desired?.set(q.map((v, i) => v + error[i]));
    const values = this.motion[quantity] && this.motion.at(quantity, t);
    this.actual.marked.forEach((material, i) => {
      const share = values ? values[i] / (peaks[i] || 1) : 0;
      material.color.copy(NEUTRAL).lerp(share < 0 ? NEGATIVE : POSITIVE, Math.min(1, Math.abs(share)));
    });
    const share = this.motion.at("travelled", t)[0] / (this.motion.travelled[0].at(-1) || 1);
    this.path.geometry.setDrawRange(0, 36 * Math.round((this.path.geometry.index.count / 36) * share)); // 6 sides of 2 triangles
  }
}

/** The picture of an arm in a canvas, and of a second beside it. */
export class Scene3D {
  constructor(host, run) {
    this.host = host;
    this.renderer = new T.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.shadowMap.enabled = true;
    host.append(this.renderer.domElement);
    this.camera = new T.PerspectiveCamera(32, 1, 0.01, 100);
    this.quantity = "torque";
    this.magnify = 1;
    this.layers = { desired: true, path: true };
    this.second = null;
    this.load(run);
    new ResizeObserver(() => this.resize()).observe(host);
    darkScheme.addEventListener("change", () => this.load(this.run));
  }

  get motion() {
    return this.puppets[0].motion;
  }

  load(run) {
    this.run = run;
    this.up = new T.Vector3(...run.arm.up);
    this.reach = run.arm.reach;
    this.scene = new T.Scene();
    this.puppets = [new Puppet(run)];
    const { box } = this.puppets[0];
    const heights = [box.min, box.max].map((p) => p.dot(this.up));
    this.floor = Math.min(...heights) - (Math.min(...heights) < -0.02 * this.reach ? 0.12 : 0.1) * this.reach;
    this.stand(this.puppets[0]);
    this.scene.add(...this.lights(), ...this.ground());
    if (this.second) this.beside(this.second);
    else this.aim();
    this.layer();
    if (this.time !== undefined) this.show(this.time);
  }

  /** Show the arm of a second run beside that of the first, or none. */
  beside(run) {
    const other = this.puppets[1], change = !run !== !other;
    this.second = run;
    if (run && other) other.follow(run);
    else if (run) {
      this.puppets.push(new Puppet(run, SECOND));
      this.stand(this.puppets[1]);
      this.puppets[1].root.position.set(0.8, 0.6, 0).applyQuaternion(this.turn).multiplyScalar(0.9 * this.reach);
    } else if (other) {
      this.scene.remove(this.puppets.pop().root);
      other.root.traverse(({ geometry, material }) => { geometry?.dispose(); material?.dispose(); });
    }
    this.names?.forEach((name) => name.remove());
    this.names = run ? [run.result ? "recorded" : this.run.name, run.name].map((words) => make("span", { class: "name" }, words)) : [];
    this.host.append(...this.names);
    if (change) this.aim();
    this.layer();
  }

  layer(changed = {}) {
    Object.assign(this.layers, changed);
    for (const { desired, path, trace } of this.puppets) {
      if (desired) desired.root.visible = this.layers.desired;
      path.visible = trace.visible = this.layers.path;
    }
    this.draw();
  }

  /** Turn of {I} that leads the z axis to the upward one. */
  get turn() {
    return new T.Quaternion().setFromUnitVectors(new T.Vector3(0, 0, 1), this.up);
  }

  lights() {
    const sun = this.sun = new T.DirectionalLight("#ffffff", 2.4);
    const side = new T.Vector3(0.5, -0.6, 0).applyQuaternion(this.turn);
    sun.position.copy(this.up).add(side).multiplyScalar(3 * this.reach);
    sun.castShadow = true;
    Object.assign(sun.shadow.camera, { near: 0.1 * this.reach, far: 8 * this.reach });
    sun.shadow.mapSize.set(1024, 1024);
    sun.shadow.normalBias = 0.01 * this.reach;
    sun.shadow.radius = 4;
    const sky = new T.HemisphereLight("#ffffff", darkScheme.matches ? "#3a4656" : "#aab4c0", 1.5);
    sky.position.copy(this.up);
    return [sun, sky];
  }

  ground() {
    const lying = new T.Quaternion().setFromUnitVectors(new T.Vector3(0, 1, 0), this.up);
    const colour = darkScheme.matches ? "#33404e" : "#d3dae2";
    const grid = new T.GridHelper(4 * this.reach, 16, colour, colour);
    const plane = new T.Mesh(new T.PlaneGeometry(20 * this.reach, 20 * this.reach).rotateX(-Math.PI / 2), new T.ShadowMaterial({ opacity: darkScheme.matches ? 0.45 : 0.2 }));
    plane.receiveShadow = true;
    for (const one of [grid, plane]) {
      one.quaternion.copy(lying);
      one.position.copy(this.up).multiplyScalar(this.floor);
    }
    return [grid, plane];
  }

  /** Put an arm into the scene, on a foot. */
  stand({ root }) {
    const r = 0.06 * this.reach, height = -this.floor - 0.6 * r;
    const foot = new T.Mesh(new T.CylinderGeometry(1.12 * r, 1.5 * r, height, 48), solid("#566270"));
    foot.quaternion.setFromUnitVectors(new T.Vector3(0, 1, 0), this.up);
    foot.position.copy(this.up).multiplyScalar(this.floor + height / 2);
    foot.castShadow = true;
    this.scene.add(root.add(foot));
  }

  aim() {
    const box = this.puppets.reduce((all, one) => all.union(one.box.clone().translate(one.root.position)), new T.Box3());
    const centre = box.getCenter(new T.Vector3());
    const size = Math.max(0.5 * this.reach, box.getSize(new T.Vector3()).length() / 2 + 0.1 * this.reach);
    const { camera } = this.sun.shadow, half = Math.max(1.5 * this.reach, size);
    Object.assign(camera, { left: -half, right: half, top: half, bottom: -half }).updateProjectionMatrix();
    const from = this.controls ? this.camera.position.clone().sub(this.controls.target) : new T.Vector3(0.95, -1.25, 0.62).applyQuaternion(this.turn);
    this.camera.up.copy(this.up);
    this.camera.position.copy(from.normalize().multiplyScalar((this.second ? 2.4 : 3) * size).add(centre));
    Object.assign(this.camera, { near: 0.02 * size, far: 60 * size });
    this.controls?.dispose();
    this.controls = new T.OrbitControls(this.camera, this.renderer.domElement);
    this.renderer.domElement.style.touchAction = "pan-y"; // a finger that moves up or down scrolls the page
    this.controls.enableDamping = !reducedMotion.matches;
    this.controls.target.copy(centre);
    this.controls.addEventListener("change", () => this.draw());
    addEventListener("beforeprint", () => this.render()); // of a frame before, nothing is kept
    this.controls.update();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.fov = width < height * 1.2 ? 40 : 32;
    this.camera.updateProjectionMatrix();
    if (this.sized) this.render(); // at once: a canvas of a new size is empty
    else this.draw();
    this.sized = true;
  }

  /** Show a time; errors may be drawn larger than they are. */
  show(t) {
    this.time = t;
    const peaks = this.peaks();
    for (const puppet of this.puppets) puppet.show(t, this.quantity, this.magnify, peaks);
    this.draw();
  }

  /** Largest absolute value of each joint over the runs that are shown. */
  peaks() {
    const [first, ...more] = this.puppets.flatMap(({ motion }) => (motion[this.quantity] ? [motion.peaks(this.quantity)] : []));
    return more.reduce((most, peaks) => most.map((v, i) => Math.max(v, peaks[i] ?? 0)), first ?? []);
  }

  draw() {
    this.waiting ??= requestAnimationFrame(() => this.render());
  }

  render() {
    cancelAnimationFrame(this.waiting);
    this.waiting = undefined;
    if (this.controls.enableDamping) this.controls.update();
    this.renderer.render(this.scene, this.camera);
    const { clientWidth: width, clientHeight: height } = this.host;
    this.names?.forEach((name, k) => {
      const { x, y } = this.up.clone().multiplyScalar(this.floor).add(this.puppets[k].root.position).project(this.camera);
      name.style.transform = `translate(${((x + 1) / 2) * width}px, ${((1 - y) / 2) * height}px) translate(-50%, 1rem)`;
    });
  }
}

function solid(color) {
  return new T.MeshStandardMaterial({ color, roughness: 0.5, metalness: 0.05 });
}

function ghost() {
  return new T.MeshStandardMaterial({ color: "#2f8fe8", transparent: true, opacity: 0.3, depthWrite: false, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2 });
}

/** A tube that leads along the points that it is given. */
function tube(radius, color, opacity) {
  const mesh = new T.Mesh(undefined, new T.MeshBasicMaterial({ color, transparent: opacity < 1, opacity }));
  mesh.along = (points) => {
    mesh.geometry.dispose();
    const path = new T.CatmullRomCurve3(points.length > 1 ? points : [points[0], points[0].clone().addScalar(1e-6)]);
    mesh.geometry = new T.TubeGeometry(path, Math.max(2, points.length), radius, 6);
  };
  return mesh;
}

/** Give the links of a chain bodies, and the end effector its axes. */
function dress(chain, { parts, reach }, material, tint) {
  const bodies = [chain.root, ...chain.links];
  const looks = { light: tint ?? (darkScheme.matches ? "#dfe6ee" : "#e9edf2"), dark: "#586473", joint: NEUTRAL };
  chain.marked = [];
  for (const { body, shape, size, offset, rotation, colour } of parts) {
    const own = new T.Color(looks[colour] ?? colour);
    const look = material(tint && !looks[colour] ? own.lerp(tint, 0.6) : own), mesh = new T.Mesh(shaped(shape, size), look);
    mesh.castShadow = mesh.receiveShadow = !look.transparent;
    mesh.setRotationFromMatrix(turned(rotation));
    mesh.position.set(...offset);
    bodies[body].add(mesh);
    if (colour === "joint") chain.marked.push(look);
  }
  if (material === ghost) return;
  ["#d22f2f", "#2f9e44", "#1667c7"].forEach((color, axis) => {
    const arrow = new T.CylinderGeometry(0.006 * reach, 0.006 * reach, 0.13 * reach, 12).translate(0, 0.065 * reach, 0);
    chain.tool.add(new T.Mesh(axis === 0 ? arrow.rotateZ(-Math.PI / 2) : axis === 2 ? arrow.rotateX(Math.PI / 2) : arrow, new T.MeshBasicMaterial({ color })));
  });
}

/** Geometry of a shape: sides, half-axes, or radius and length along z. */
function shaped(shape, [a, b, c]) {
  if (shape === "box") return new T.BoxGeometry(a, b, c);
  if (shape === "cylinder") return new T.CylinderGeometry(a, a, b, 40).rotateX(Math.PI / 2);
  if (shape === "capsule") return new T.CapsuleGeometry(a, b, 10, 32).rotateX(Math.PI / 2);
  return new T.SphereGeometry(1, 40, 20).scale(a, b ?? a, c ?? a);
}
