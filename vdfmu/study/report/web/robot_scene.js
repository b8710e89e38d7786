// The picture of a robot: its frames, centres of mass, ellipsoids of inertia, and the direction of gravity.

import { axesOf, dress, solid } from "./arm.js";
import { make, robot } from "./data.js";
import { Scene3D } from "./scene.js";
import { Arrow } from "./world.js";
import { vendor } from "./vendor.js";

/** Opacity of the links. */
export const LINKS = { solid: 1, "see-through": 0.4, hidden: 0 };

/** The arm of a robot with its frames, masses and the direction of gravity. */
export class RobotScene extends Scene3D {
  load(run) {
    super.load(run);
    const [{ actual, arcs }] = this.puppets[0].arms,
      { reach } = this,
      length = 0.1 * reach;
    this.chain = actual;
    this.labels?.forEach(({ span }) => span.remove());
    /** Names in the picture: the place that each is at. @type {{ parent: any, anchor: any, span: HTMLElement }[]} */
    this.labels = [];
    /** What is shown and hidden together. @type {Record<string, any[]>} */
    this.groups = { frames: [], centres: [], ellipsoids: [], gravity: [] };
    arcs.forEach((arc) => arc?.turned.removeFromParent());
    actual.tool.clear();
    this.bodies = [];
    actual.root.traverse((one) => one.isMesh && this.bodies.push(one));
    const bodies = [actual.root, ...actual.links],
      frame = (parent, size, name, axis) => {
        const axes = axesOf(size);
        parent.add(axes);
        this.groups.frames.push(axes);
        this.label(axes, name, new vendor.Vector3().setComponent(axis, 1.25 * length)); // at tips of their own: some frames are at one place
      };
    bodies.forEach((body, i) =>
      frame(body, (i ? 1 : 1.3) * length, i ? `{B_${i}}` : "{I}", i ? 2 : 0),
    );
    frame(actual.tool, 1.3 * length, "{O}", 1);
    for (const [body, place] of robot.centres) {
      const ball = new vendor.Mesh(
        new vendor.SphereGeometry(0.014 * reach, 24, 12),
        solid("#be185d"),
      );
      ball.position.set(...place);
      bodies[body].add(ball);
      this.groups.centres.push(ball);
    }
    const seen = (colour) =>
        Object.assign(solid(colour), { transparent: true, opacity: 0.45, depthWrite: false }),
      before = new Set();
    actual.root.traverse((one) => before.add(one));
    dress(actual, { parts: robot.ellipsoids }, seen);
    actual.root.traverse((one) => !before.has(one) && this.groups.ellipsoids.push(one));
    if (!robot.weightless) {
      const pull = new Arrow(0.25 * reach);
      pull.position
        .set(0.05, 0.5, 0.12)
        .applyQuaternion(this.turn)
        .multiplyScalar(reach)
        .add(this.puppets[0].box.getCenter(new vendor.Vector3()));
      pull.point(this.up.clone().negate(), 1);
      pull.look.color.set("#66717d");
      this.scene.add(pull);
      this.groups.gravity.push(pull);
      this.label(pull, "g", new vendor.Vector3());
    }
    this.apply();
  }

  label(parent, name, place) {
    const anchor = new vendor.Group(),
      span = make("span", { class: "name", "aria-hidden": "true" }, name);
    anchor.position.copy(place);
    parent.add(anchor);
    this.host.append(span);
    this.labels.push({ parent, anchor, span });
  }

  /** Show what is chosen, at a pose. */
  apply(changed = {}) {
    this.chosen = {
      links: "solid",
      frames: false,
      centres: false,
      ellipsoids: false,
      gravity: true,
      ...this.chosen,
      ...changed,
    };
    for (const [name, members] of Object.entries(this.groups))
      for (const one of members) one.visible = this.chosen[name];
    const opacity = LINKS[this.chosen.links];
    for (const body of this.bodies) {
      body.visible = opacity > 0;
      Object.assign(body.material, {
        transparent: opacity < 1,
        opacity,
        depthWrite: opacity === 1,
        needsUpdate: true,
      });
      body.castShadow = opacity === 1;
    }
    this.pose(this.q ?? this.run.arm.types.map(() => 0));
  }

  /** Position [m] and roll, pitch and yaw [rad] of the end effector in {I}, at the pose that is drawn; roll is 0 where pitch is ±90°. */
  toolPose() {
    const m = this.chain.tool.matrixWorld.elements, // column by column
      flat = Math.hypot(m[0], m[1]),
      turns = flat > 1e-7;
    return {
      position: [m[12], m[13], m[14]],
      angles: [
        turns ? Math.atan2(m[6], m[10]) : 0,
        Math.atan2(-m[2], flat),
        turns ? Math.atan2(m[1], m[0]) : Math.atan2(-m[4], m[5]),
      ],
    };
  }

  pose(q) {
    this.q = q;
    this.chain.set(q);
    this.draw();
  }

  render() {
    super.render();
    for (const { parent, anchor, span } of this.labels) {
      span.style.visibility = parent.visible ? "visible" : "hidden";
      this.write(span, new vendor.Vector3().setFromMatrixPosition(anchor.matrixWorld), "-50%");
    }
  }
}
