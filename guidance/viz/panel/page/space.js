// The 3D view: lines and points in perspective, with a camera that is turned by dragging.
import { EVADER, PURSUER, Surface, ink, roundStep } from "./surface.js";
import { circle, steer, track } from "./plan.js";
import { playersOf } from "./team.js";
import { TEXTS } from "./texts.js";

const NEAR = 0.05;

export class Space {
  constructor(canvas) {
    this.surface = new Surface(canvas);
    this.turn = -0.6; // rad about the vertical, from north
    this.tilt = 0.45; // rad above the horizon
    this.away = 1; // factor on the distance that shows everything
    this.middle = null;
    this.reach = 0;
    steer(canvas, {
      drag: (dx, dy) => this.look(dx, dy),
      zoom: (factor) => this.zoom(factor),
      fit: () => this.fit(),
    });
  }

  look(dx, dy) {
    this.turn += 0.008 * dx;
    this.tilt = Math.min(1.55, Math.max(0.05, this.tilt + 0.008 * dy));
    this.draw();
  }

  zoom(factor) {
    this.away = Math.min(8, Math.max(0.1, this.away / factor));
    this.draw();
  }

  fit() {
    [this.turn, this.tilt, this.away, this.middle] = [-0.6, 0.45, 1, null];
    this.draw();
  }

  show(daemon, team) {
    [this.daemon, this.team] = [daemon, team];
    this.draw();
  }

  draw() {
    if (!this.surface.begin() || !this.daemon) return;
    const { snapshot: seen, scene } = this.daemon;
    const players = playersOf(this.daemon, this.team);
    if (!seen?.pursuer_m || !scene) {
      this.surface.text(TEXTS.map.wait, this.surface.width / 2, 24, ink("--faint"), "center");
      return;
    }
    this.ground = scene.home_m?.[2] ?? 0;
    const places = players.flatMap((one) => [one.pursuer, one.target, one.meeting]);
    this.aim([...places, scene.home_m, scene.target_m].filter((place) => place?.length === 3));
    this.floor();
    this.still(scene);
    for (const { rows } of players) {
      for (const [from, colour, dash] of [[EVADER, "--evader", [6, 4]], [PURSUER, "--pursuer", []]]) {
        const flown = track(rows, from);
        this.curve(flown.map((place) => place && [place[0], place[1], this.ground]), "--line", 2);
        this.curve(flown, colour, 2, dash);
      }
    }
    for (const one of [...players].reverse()) if (one.pursuer && one.scene) this.moving(one);
  }

  aim(places) {
    const spans = [0, 1, 2].map((axis) => {
      const values = places.map((place) => place[axis]);
      return [Math.min(...values), Math.max(...values)];
    });
    const middle = spans.map(([low, high]) => (low + high) / 2);
    const reach = Math.max(20, ...spans.map(([low, high]) => high - low));
    const moved = this.middle && Math.hypot(...middle.map((value, axis) => value - this.middle[axis]));
    if (!this.middle || moved > 0.25 * this.reach || reach > 1.2 * this.reach || reach < 0.5 * this.reach) {
      [this.middle, this.reach] = [middle, reach];
    }
  }

  // Pixel of a point, null behind the camera.
  pixel([x, y, z]) {
    const { width, height } = this.surface;
    const [dx, dy, dz] = [x - this.middle[0], y - this.middle[1], z - this.middle[2]];
    const [sinTurn, cosTurn, sinTilt, cosTilt] = [
      Math.sin(this.turn), Math.cos(this.turn), Math.sin(this.tilt), Math.cos(this.tilt),
    ];
    const right = dx * cosTurn - dy * sinTurn;
    const ahead = dx * sinTurn + dy * cosTurn;
    const depth = 1.7 * this.reach * this.away + ahead * cosTilt - dz * sinTilt;
    const up = dz * cosTilt + ahead * sinTilt;
    if (depth < NEAR * this.reach) return null;
    const scale = (1.02 * Math.min(width, height)) / depth;
    return [width / 2 + right * scale, height / 2 - up * scale];
  }

  curve(places, colour, width = 1.5, dash = []) {
    this.surface.line(places.map((place) => place && this.pixel(place)), ink(colour), width, dash);
  }

  floor() {
    const step = roundStep(4 * this.reach, 16);
    const [x0, y0] = this.middle.map((value) => Math.round(value / step) * step);
    for (let at = -8; at <= 8; at++) {
      const far = 8 * step;
      // In pieces, so that the visible part of a line that passes the camera is drawn.
      const pieces = [...Array(33).keys()].map((piece) => ((piece - 16) * far) / 16);
      this.curve(pieces.map((along) => [x0 + at * step, y0 + along, this.ground]), "--grid", 1);
      this.curve(pieces.map((along) => [x0 + along, y0 + at * step, this.ground]), "--grid", 1);
    }
    this.name(TEXTS.map.north, [x0, y0 + 8 * step, this.ground], "--faint");
  }

  still(scene) {
    for (const edge of scene.fence_m) {
      for (const above of [0, scene.ceiling_m]) this.curve(edge.map(([x, y]) => [x, y, this.ground + above]), "--fence", 1.5, [8, 5]);
      const every = Math.max(1, Math.round(edge.length / 12));
      edge.forEach(([x, y], at) => {
        if (at % every === 0) this.curve([[x, y, this.ground], [x, y, this.ground + scene.ceiling_m]], "--fence", 0.7);
      });
    }
    if (scene.home_m) this.mark(scene.home_m, "--faint", TEXTS.map.home);
    if (scene.target_edge_m?.length) this.curve(scene.target_edge_m.map(([x, y]) => [x, y, this.ground]), "--ink", 2);
    if (scene.target_m) this.mark([scene.target_m[0], scene.target_m[1], this.ground], "--ink", TEXTS.map.target);
  }

  moving({ pursuer, target: evader, meeting: met, isochron, scene, name, evaderName, out }) {
    if (isochron) this.curve(isochron.map(([x, y]) => [x, y, evader?.[2] ?? this.ground]), "--isochron", 1.5, [2, 4]);
    if (evader && out) this.mark(evader, "--evader", TEXTS.out(evaderName), 4, 14);
    else if (evader) {
      const { radius, height } = scene.standoff_m;
      const rim = circle(evader, radius).map(([x, y]) => [x, y, evader[2] + height]);
      const seenRim = rim.map((place) => this.pixel(place));
      if (seenRim.every(Boolean)) this.surface.fill(seenRim, ink("--disc"), 0.18);
      this.curve(rim, "--disc", 2.5);
      for (const at of [0, 18, 36, 54]) this.curve([rim[at], [rim[at][0], rim[at][1], evader[2]]], "--disc", 1, [3, 4]);
      this.mark(evader, "--evader", evaderName, 5, 14);
    }
    if (met) {
      const meeting = [met[0], met[1], evader?.[2] ?? this.ground];
      this.curve([pursuer, meeting], "--meeting", 1.5, [5, 4]);
      const at = this.pixel(meeting);
      if (at) this.surface.star(at, 8, ink("--meeting"));
    }
    this.curve([pursuer, [pursuer[0], pursuer[1], this.ground]], "--pursuer", 1, [3, 3]);
    this.mark(pursuer, "--pursuer", name, 7);
  }

  mark(place, colour, words, radius = 5, below = -9) {
    const at = this.pixel(place);
    if (!at) return;
    this.surface.dot(at, radius, ink(colour));
    this.name(words, place, colour, below);
  }

  name(words, place, colour, below = -9) {
    const at = this.pixel(place);
    if (at) this.surface.text(words, at[0] + 9, at[1] + below, ink(colour));
  }
}
