// The arms of a run in a scene, each in its actual and its desired position, its path, and the objects it touches.

import { darkScheme, inkOf } from "./data.js";
import { Chain, Motion, NEGATIVE, NEUTRAL, POSITIVE, armsOf, dress, ghost, solid } from "./arm.js";
import { Arc, Arrow, drawn, plate } from "./world.js";
import { vendor } from "./vendor.js";

/** An arm: `actual`, `desired`, and the path of its tool in {I}. */
class Arm {
  constructor(one, tint) {
    const { arm } = one;
    this.arm = arm;
    this.component = one.component ?? one.name;
    this.mounted = one.mounted;
    this.error = !!one.frames.error;
    /** @type {Motion | null} */
    this.motion = null;
    /** Largest lengths of parts of its wrenches. @type {Record<string, number>} */
    this.lengths = {};
    this.actual = new Chain(arm);
    this.bare = new Chain(arm); // of frames alone, which is quick to place
    this.desired = this.error ? new Chain(arm) : null;
    this.path = new Path(0.0045 * arm.reach, inkOf("positive"), 1);
    this.trace = new Path(0.0025 * arm.reach, darkScheme.matches ? "#9aa7b5" : "#66717d", 0.55);
    dress(this.actual, arm, solid, tint);
    if (this.desired) dress(this.desired, arm, ghost, tint);
    if (!this.mounted) this.actual.root.add((this.plate = plate(arm)));
    this.arcs = arm.types.map((type, i) =>
      type === "prismatic" || arm.types.length > 8
        ? null
        : new Arc(0.12 * arm.reach * (1 - (0.42 * i) / Math.max(1, arm.types.length - 1))),
    );
    this.arcs.forEach((arc, i) => arc && this.actual.links[i].add(arc.turned));
    this.arrows = ["F_e", "F_S"]
      .filter((name) => one.frames[name])
      .map((name) => {
        const force = new Arrow(0.4 * arm.reach),
          moment = new Arc(0.13 * arm.reach);
        (name === "F_e" ? this.actual.tool : this.actual.root).add(force, moment.turned);
        return { name, force, moment };
      });
  }

  /** Desired positions of the joints, at positions. */
  desiredAt(t, q) {
    const error = this.motion.at("error", t);
    return q.map((v, i) => v + error[i]);
  }

  base(t) {
    return this.motion.base && !this.mounted ? this.motion.at("base", t) : null;
  }

  /** Largest length of the force or the moment of a wrench. */
  largest(name, first) {
    const rows = this.motion[name].slice(first, first + 3);
    this.lengths[name + first] ??= rows[0].reduce(
      (most, _, k) => Math.max(most, Math.hypot(...rows.map((row) => row[k]))),
      0,
    );
    return this.lengths[name + first];
  }

  /** Show joints by the share of their largest values, and wrenches. */
  show(t, quantity, peaks, forces) {
    const values = this.motion[quantity] && this.motion.at(quantity, t);
    this.actual.marked.forEach((material, i) => {
      const share = values ? values[i] / (peaks[i] || 1) : 0;
      material.color
        .copy(NEUTRAL)
        .lerp(share < 0 ? NEGATIVE : POSITIVE, Math.min(1, Math.abs(share)));
      this.arcs[i]?.wind(forces && quantity === "torque" ? share : 0, material.color);
    });
    for (const { name, force, moment } of this.arrows) {
      const wrench = forces ? this.motion.at(name, t) : [0, 0, 0, 0, 0, 0];
      force.point(wrench.slice(0, 3), this.largest(name, 0));
      moment.point(wrench.slice(3), this.largest(name, 3));
    }
  }
}

/** A tube along the way of a tool, as far as it has come. */
class Path extends vendor.Group {
  constructor(radius, color, opacity) {
    super();
    const look = new vendor.MeshBasicMaterial({ color, transparent: opacity < 1, opacity });
    this.tube = new vendor.Mesh(undefined, look);
    this.end = new vendor.Mesh(
      new vendor.CylinderGeometry(radius, radius, 1, 6).rotateX(Math.PI / 2).translate(0, 0, 0.5),
      look,
    );
    this.end.visible = false;
    this.add(this.tube, this.end);
    this.radius = radius;
  }

  /** Lead straight from point to point, which are reached at `times`; points that are almost at the same place are skipped. */
  along(points, times) {
    const kept = [...points.keys()].filter(
      ((last) => (k) => {
        const far = k === 0 || points[k].distanceTo(points[last]) > 0.2 * this.radius;
        if (far) last = k;
        return far;
      })(0),
    );
    this.points = kept.map((k) => points[k]);
    this.times = kept.map((k) => times[k]);
    const { length } = this.points,
      curve = new vendor.CatmullRomCurve3(this.points, false, "catmullrom", 0);
    curve.getUtoTmapping = (u) => u; // the points in equal steps, with straight lines between them
    this.tube.geometry.dispose();
    this.tube.visible = length > 1;
    if (length > 1) this.tube.geometry = new vendor.TubeGeometry(curve, length - 1, this.radius, 6);
  }

  /** Show it up to a time, and from there to the tool. */
  until(t, tool) {
    const next = this.times.findIndex((time) => time > t),
      k = (next < 0 ? this.times.length : Math.max(1, next)) - 1;
    this.tube.geometry.setDrawRange(0, 36 * k); // 6 sides of 2 triangles
    const from = this.points[k],
      length = from.distanceTo(tool);
    this.end.visible = length > 0;
    this.end.position.copy(from);
    this.end.scale.z = length;
    this.end.lookAt(this.localToWorld(tool.clone()));
  }
}

/** The arms of a run, and the objects that they touch. */
export class Puppet {
  constructor(run, tint = null) {
    this.root = new vendor.Group();
    this.arms = armsOf(run).map((one) => new Arm(one, tint));
    for (const [k, arm] of this.arms.entries()) {
      const carrier = this.arms.slice(0, k).find(({ component }) => component === arm.mounted);
      (carrier?.actual.tool ?? this.root).add(arm.actual.root);
      carrier?.bare.tool.add(arm.bare.root);
      if (arm.desired)
        (carrier?.desired?.tool ?? carrier?.actual.tool ?? this.root).add(arm.desired.root);
      this.root.add(arm.path, arm.trace);
    }
    this.objects = [];
    this.follow(run);
    this.objects = (run.objects ?? []).map((object) => {
      const arm = this.arms.find(({ component }) => component === object.tool) ?? this.arms[0];
      return drawn(object, arm.trace.points, arm.arm.reach);
    });
    for (const object of this.objects) {
      this.root.add(object);
      const along = new vendor.Vector3(...object.object.direction).multiplyScalar(
        0.4 * run.arm.reach,
      ); // of the largest arrow
      this.box.expandByPoint(object.position).expandByPoint(along.add(object.position));
    }
  }

  get motion() {
    return this.arms[0].motion;
  }

  /** Take over the motion of a run: its paths, and the space that it needs. */
  follow(run) {
    armsOf(run).forEach((one, k) => {
      Object.assign(this.arms[k], { motion: new Motion(one), lengths: {} });
    });
    this.lead((this.box = new vendor.Box3()));
  }

  /** Place all arms at a time, without what colours them. */
  pose(t) {
    for (const arm of this.arms) {
      const q = arm.motion.at("q", t),
        base = arm.base(t);
      arm.actual.set(q, base);
      arm.desired?.set(arm.desiredAt(t, q), base);
    }
    this.root.updateMatrixWorld(true);
  }

  /** Lead the paths through the tools, and make the box hold all that moves. */
  lead(box) {
    const point = new vendor.Vector3();
    for (const arm of this.arms) {
      const chain = this.arms.filter((one) => one === arm || arm.mounted);
      const times = arm.motion.time,
        step = Math.max(1, Math.floor(times.length / 250));
      const points = Array.from(times, (t, k) => {
        for (const one of chain) one.bare.set(one.motion.at("q", t), one.base(t));
        for (const link of k % step === 0 ? [arm.bare.root, ...arm.bare.links] : [])
          box.expandByPoint(point.setFromMatrixPosition(link.matrixWorld));
        const tool = new vendor.Vector3().setFromMatrixPosition(arm.bare.tool.matrixWorld);
        box.expandByPoint(tool);
        return tool;
      });
      arm.path.along(points, times);
      arm.trace.along(points, times);
    }
  }

  /** Values of a quantity of all joints, arm after arm; NaN where it is not known. */
  values(name, t) {
    return this.arms.flatMap(({ motion, arm }) =>
      motion[name] ? motion.at(name, t) : arm.types.map(() => NaN),
    );
  }

  peaks(name) {
    return this.arms.flatMap(({ motion, arm }) =>
      motion[name] ? motion.peaks(name) : arm.types.map(() => 0),
    );
  }

  show(t, quantity, peaks, forces) {
    this.pose(t);
    let first = 0;
    for (const arm of this.arms) {
      arm.show(t, quantity, peaks.slice(first), forces);
      first += arm.arm.types.length;
      arm.path.until(
        t,
        this.root.worldToLocal(
          new vendor.Vector3().setFromMatrixPosition(arm.actual.tool.matrixWorld),
        ),
      );
    }
    for (const drawing of this.objects)
      if (this.motion[drawing.object.turn]) drawing.turn(this.motion.at(drawing.object.turn, t)[0]);
  }
}
