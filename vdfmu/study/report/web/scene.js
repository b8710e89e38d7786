// The picture of the arms of a run in a canvas, and of a second run beside it.

import { choice, darkScheme, make, reducedMotion, same } from "./data.js";
import { Puppet } from "./puppet.js";
import { vendor } from "./vendor.js";

const SECOND = new vendor.Color("#f2b632");
/** From where to look, for z upward; with the keys 1 to 4. */
const VIEWS = {
  front: [1, 0, 0],
  side: [0, -1, 0],
  top: [0, -1e-3, 1],
  perspective: [0.95, -1.25, 0.62],
};

/** A list of the views of a scene. */
export const viewChoice = (scene) =>
  choice("View", same(VIEWS).reverse(), (name) => scene.look(name));

/** The picture of a run in a canvas, and of a second beside it. */
export class Scene3D {
  constructor(host, run) {
    this.host = host;
    this.renderer = new vendor.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.shadowMap.enabled = true;
    host.append(this.renderer.domElement);
    this.camera = new vendor.PerspectiveCamera(32, 1, 0.01, 100);
    this.quantity = "torque";
    this.layers = { desired: true, path: true, forces: true };
    this.second = null;
    this.load(run);
    new ResizeObserver(() => this.resize()).observe(host);
    darkScheme.addEventListener("change", () => this.load(this.run));
    host.tabIndex = 0;
    host.addEventListener("keydown", (event) => this.key(event));
    document.addEventListener("keydown", ({ key, target, ctrlKey, metaKey, altKey }) => {
      const view = Object.keys(VIEWS)[Number(key) - 1];
      const typed = target instanceof HTMLInputElement || target instanceof HTMLSelectElement;
      if (view && !(ctrlKey || metaKey || altKey || typed)) this.look(view);
    });
  }

  get motion() {
    return this.puppets[0].motion;
  }

  load(run) {
    this.run = run;
    this.up = new vendor.Vector3(...run.arm.up);
    this.reach = run.arm.reach;
    this.scene = new vendor.Scene();
    this.puppets = [new Puppet(run)];
    this.floor = this.ground(this.puppets[0]);
    this.scene.add(this.puppets[0].root, ...this.lights(), ...this.grid());
    if (this.second) this.beside(this.second);
    else this.aim();
    this.layer();
    const { arms, objects } = this.puppets[0];
    const seen = [
      ...(arms.length > 1 ? arms.map(({ component }) => component) : []),
      ...objects.map(({ object: { kind, component } }) => `the ${kind} ${component}`),
    ];
    this.host.setAttribute(
      "aria-label",
      `The arm in 3D${seen.length ? ` with ${seen.join(", ")}` : ""}; drag or use the arrow keys to turn, two fingers, Ctrl and the wheel, or + and - to zoom, ` +
        Object.keys(VIEWS)
          .map((view, k) => `${k + 1} for ${view}`)
          .join(", "),
    );
  }

  /** Show the arm of a second run beside that of the first, or none. */
  beside(run) {
    const other = this.puppets[1],
      change = !run !== !other;
    this.second = run;
    if (run && other) other.follow(run);
    else if (run) {
      this.puppets.push(new Puppet(run, SECOND));
      this.scene.add(this.puppets[1].root);
      this.puppets[1].root.position
        .set(0.8, 0.6, 0)
        .applyQuaternion(this.turn)
        .multiplyScalar(0.9 * this.reach);
    } else if (other) {
      this.scene.remove(this.puppets.pop().root);
      other.root.traverse(({ geometry, material }) => {
        geometry?.dispose();
        material?.dispose();
      });
    }
    this.names?.forEach((name) => name.remove());
    this.names = run
      ? [run.result ? "recorded" : this.run.name, run.name].map((words) =>
          make("span", { class: "name" }, words),
        )
      : [];
    this.host.append(...this.names);
    if (change) this.aim();
    this.layer();
  }

  layer(changed = {}) {
    Object.assign(this.layers, changed);
    for (const { desired, path, trace } of this.puppets.flatMap(({ arms }) => arms)) {
      if (desired) desired.root.visible = this.layers.desired;
      path.visible = trace.visible = this.layers.path;
    }
    if (this.time === undefined) this.draw();
    else this.show(this.time);
  }

  /** Turn of {I} that leads the z axis to the upward one. */
  get turn() {
    return new vendor.Quaternion().setFromUnitVectors(new vendor.Vector3(0, 0, 1), this.up);
  }

  lights() {
    const sun = (this.sun = new vendor.DirectionalLight("#ffffff", 2.4));
    const side = new vendor.Vector3(0.5, -0.6, 0).applyQuaternion(this.turn);
    sun.position
      .copy(this.up)
      .add(side)
      .multiplyScalar(3 * this.reach);
    sun.castShadow = true;
    Object.assign(sun.shadow.camera, { near: 0.1 * this.reach, far: 8 * this.reach });
    sun.shadow.mapSize.set(1024, 1024);
    sun.shadow.normalBias = 0.01 * this.reach;
    sun.shadow.radius = 4;
    const sky = new vendor.HemisphereLight(
      "#ffffff",
      darkScheme.matches ? "#3a4656" : "#aab4c0",
      1.5,
    );
    sky.position.copy(this.up);
    return [sun, sky];
  }

  /** Height of the floor: under the plates on which arms stand, or below all that moves. */
  ground({ arms, box }) {
    const lowest = Math.min(...[box.min, box.max].map((p) => p.dot(this.up)));
    const stands = arms.map(({ plate, arm }) =>
      plate && this.up.dot(new vendor.Vector3(...arm.mount)) < -0.9 ? -plate.reaches : 0,
    );
    const under = Math.min(...stands);
    return lowest < Math.min(under, -0.02 * this.reach) || under === 0
      ? lowest - 0.1 * this.reach
      : under;
  }

  grid() {
    const lying = new vendor.Quaternion().setFromUnitVectors(new vendor.Vector3(0, 1, 0), this.up);
    const colour = darkScheme.matches ? "#33404e" : "#d3dae2";
    const grid = new vendor.GridHelper(4 * this.reach, 16, colour, colour);
    const plane = new vendor.Mesh(
      new vendor.PlaneGeometry(20 * this.reach, 20 * this.reach).rotateX(-Math.PI / 2),
      new vendor.ShadowMaterial({ opacity: darkScheme.matches ? 0.45 : 0.2 }),
    );
    plane.receiveShadow = true;
    for (const one of [grid, plane]) {
      one.quaternion.copy(lying);
      one.position.copy(this.up).multiplyScalar(this.floor);
    }
    return [grid, plane];
  }

  aim() {
    const box = this.puppets.reduce(
      (all, one) => all.union(one.box.clone().translate(one.root.position)),
      new vendor.Box3(),
    );
    const centre = box.getCenter(new vendor.Vector3());
    const size = Math.max(
      0.5 * this.reach,
      box.getSize(new vendor.Vector3()).length() / 2 + 0.1 * this.reach,
    );
    const { camera } = this.sun.shadow,
      half = Math.max(1.5 * this.reach, size);
    Object.assign(camera, {
      left: -half,
      right: half,
      top: half,
      bottom: -half,
    }).updateProjectionMatrix();
    const from = this.controls
      ? this.camera.position.clone().sub(this.controls.target)
      : this.from("perspective");
    this.camera.up.copy(this.up);
    this.camera.position.copy(
      from
        .normalize()
        .multiplyScalar((this.second ? 2.6 : 3.3) * size)
        .add(centre),
    );
    Object.assign(this.camera, { near: 0.02 * size, far: 60 * size });
    this.controls?.dispose();
    this.controls = new vendor.OrbitControls(this.camera, this.renderer.domElement);
    this.renderer.domElement.style.touchAction = "pan-y"; // a finger that moves up or down scrolls the page
    this.controls.enableDamping = !reducedMotion.matches;
    this.controls.target.copy(centre);
    this.controls.addEventListener("change", () => this.draw());
    addEventListener("beforeprint", () => this.render()); // of a frame before, nothing is kept
    this.controls.update();
  }

  from(view) {
    return new vendor.Vector3(...VIEWS[view]).applyQuaternion(this.turn);
  }

  /** Look from the front, the side or the top, or in perspective. */
  look(view) {
    const away = this.camera.position.distanceTo(this.controls.target);
    this.camera.position.copy(
      this.from(view).normalize().multiplyScalar(away).add(this.controls.target),
    );
    this.controls.update();
    this.draw();
  }

  /** Turn by arrow keys, zoom by + and -. */
  key(event) {
    const turns = {
      ArrowLeft: [-1, 0],
      ArrowRight: [1, 0],
      ArrowUp: [0, 1],
      ArrowDown: [0, -1],
      "+": [0, 0, 0.9],
      "=": [0, 0, 0.9],
      "-": [0, 0, 1 / 0.9],
    };
    const [aside, over, nearer = 1] = turns[event.key] ?? [];
    if (aside === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    const off = this.camera.position.clone().sub(this.controls.target),
      tilt = off.angleTo(this.up);
    const across = new vendor.Vector3().crossVectors(off, this.up).normalize();
    off.applyAxisAngle(
      across,
      Math.min(tilt - 0.02, Math.max(tilt - Math.PI + 0.02, (over * Math.PI) / 36)),
    );
    off.applyAxisAngle(this.up, (aside * Math.PI) / 36).multiplyScalar(nearer);
    this.camera.position.copy(this.controls.target).add(off);
    this.controls.update();
    this.draw();
    event.preventDefault();
    event.stopPropagation(); // else it moves the time
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.fov = width < height * 1.2 ? 40 : 32;
    this.camera.updateProjectionMatrix();
    if (this.sized)
      this.render(); // at once: a canvas of a new size is empty
    else this.draw();
    this.sized = true;
  }

  /** Show a time; errors may be drawn larger than they are. */
  show(t) {
    this.time = t;
    const peaks = this.peaks();
    for (const puppet of this.puppets) puppet.show(t, this.quantity, peaks, this.layers.forces);
    this.draw();
  }

  /** Largest absolute value of each joint over the runs that are shown. */
  peaks() {
    const [first, ...more] = this.puppets.map((puppet) => puppet.peaks(this.quantity));
    return more.reduce((most, peaks) => most.map((v, i) => Math.max(v, peaks[i] ?? 0)), first);
  }

  draw() {
    this.waiting ??= requestAnimationFrame(() => this.render());
  }

  render() {
    cancelAnimationFrame(this.waiting);
    this.waiting = undefined;
    if (this.controls.enableDamping) this.controls.update();
    this.renderer.render(this.scene, this.camera);
    this.names?.forEach((name, k) => {
      const at = this.up.clone().multiplyScalar(this.floor).add(this.puppets[k].root.position);
      this.write(name, at, "1rem");
    });
  }

  /** Put words where a point is seen, moved down. */
  write({ style }, point, down) {
    const { x, y } = point.project(this.camera);
    style.transform = `translate(${50 * (x + 1)}cqw, ${50 * (1 - y)}cqh) translate(-50%, ${down})`;
  }
}
