// Height above home over the distance to the evader, or to home if no evader is known.
import { EVADER, PURSUER, Surface, fixed, ink, roundStep } from "./surface.js";
import { TEXTS } from "./texts.js";

const [LEFT, BOTTOM, TOP, RIGHT] = [34, 20, 34, 10];
const TRAIL = 240;

export class Profile {
  constructor(canvas) {
    this.surface = new Surface(canvas);
    this.reach = this.high = this.low = 0;
  }

  show(daemon) {
    const { snapshot: seen, scene, rows } = daemon;
    if (!this.surface.begin() || !scene?.home_m) return;
    const home = scene.home_m;
    const toEvader = Boolean(seen?.evader_m);
    const flat = (one, other) => Math.hypot(one[0] - other[0], one[1] - other[1]);
    const trail = rows.slice(-TRAIL).map((row) => {
      const [here, evader] = [row[PURSUER], row[EVADER]];
      const from = toEvader ? evader : home;
      return here && from ? [flat(here, from), here[2] - home[2]] : null;
    });
    const now = seen?.pursuer_m ? [flat(seen.pursuer_m, toEvader ? seen.evader_m : home), seen.pursuer_m[2] - home[2]] : null;
    const disc = toEvader ? [scene.standoff_m.radius, seen.evader_m[2] - home[2] + scene.standoff_m.height] : null;
    this.frame([...trail, now, disc].filter(Boolean), scene);
    this.axes(toEvader, scene);
    if (disc) this.disc(disc, seen.evader_m[2] - home[2]);
    this.surface.line(trail.map((one) => one && this.pixel(one)), ink("--pursuer"), 2);
    if (now) {
      const at = this.pixel(now);
      this.surface.dot(at, 6, ink("--pursuer"));
      this.surface.text(`${fixed(now[1], 1)} m`, at[0] - 10, at[1] - 12, ink("--pursuer"), at[0] > 70 ? "right" : "left");
    }
  }

  frame(places, scene) {
    const reach = 1.15 * Math.max(10, ...places.map(([far]) => far));
    const high = 1.25 * Math.max(scene.floor_m + 5, ...places.map(([, above]) => above));
    const least = Math.min(...places.map(([, above]) => above));
    const low = least < -0.2 ? 1.5 * least : 0; // the height of home is inexact
    if (low < this.low || low > 0.5 * this.low) this.low = low;
    if (reach > this.reach || reach < 0.5 * this.reach) this.reach = reach;
    if (high > this.high || high < 0.5 * this.high) this.high = high;
  }

  pixel([far, above]) {
    const { width, height } = this.surface;
    return [
      LEFT + (far / this.reach) * (width - LEFT - RIGHT),
      height - BOTTOM - ((above - this.low) / (this.high - this.low)) * (height - BOTTOM - TOP),
    ];
  }

  axes(toEvader, scene) {
    const { surface } = this;
    this.ticks(this.reach, 4, (far) => [[far, this.low], [far, this.high]], "center", 0, 11);
    this.ticks(this.high, 6, (above) => [[0, above], [this.reach, above]], "right", -5, 0);
    for (const [name, above] of [["floor", scene.floor_m], ["ceiling", scene.ceiling_m]]) {
      if (above > this.high) continue;
      const [from, to] = [this.pixel([0, above]), this.pixel([this.reach, above])];
      surface.line([from, to], ink("--fence"), 2, [10, 5]);
      surface.text(TEXTS.map[name], to[0] - 2, to[1] - 8, ink("--fence"), "right");
    }
    const words = toEvader ? TEXTS.profile : TEXTS.profileHome;
    surface.font(11);
    words.forEach((part, at) => surface.text(part, 6, 10 + 14 * at, ink("--faint")));
    surface.font(12);
  }

  ticks(length, most, line, align, dx, dy) {
    const step = roundStep(length, most);
    for (let value = 0; value <= length; value += step) {
      const ends = line(value).map((one) => this.pixel(one));
      this.surface.line(ends, ink("--grid"));
      this.surface.text(String(Number(value.toFixed(3))), ends[0][0] + dx, ends[0][1] + dy, ink("--faint"), align);
    }
  }

  disc([radius, above], evader) {
    const [from, to] = [this.pixel([0, above]), this.pixel([radius, above])];
    this.surface.line([from, to], ink("--disc"), 4);
    this.surface.line([to, this.pixel([radius, evader])], ink("--disc"), 1, [3, 4]);
    const [x, y] = this.pixel([0, evader]);
    this.surface.text(TEXTS.map.disc, to[0] + 4, 0.4 * to[1] + 0.6 * y, ink("--disc"));
    this.surface.fill([[x - 7, y], [x, y - 7], [x + 7, y], [x, y + 7]], ink("--evader"));
  }
}
