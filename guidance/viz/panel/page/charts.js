// Charts of the last five minutes: the columns of the history, by chart.
import { Surface, fixed, ink, roundStep } from "./surface.js";
import { TEXTS } from "./texts.js";

const CHARTS = [
  ["range", { gap_m: ["--pursuer", []], height_gap_m: ["--evader", [5, 3]] }],
  ["reach", {
    "game.value": ["--isochron", [5, 3]],
    "game.time_needed_s": ["--pursuer", []],
    "game.assured_distance_m": ["--pursuer", []],
  }],
  ["speed", {
    "speed_m_s.flown": ["--isochron", []],
    "speed_m_s.commanded": ["--pursuer", [5, 3]],
    "speed_m_s.desired": ["--evader", [2, 3]],
  }],
  ["age", { "age_s.position": ["--pursuer", []], "age_s.evader": ["--evader", [5, 3]] }],
];
const LEFT_OUT = { s: "game.assured_distance_m", m: "game.time_needed_s" }; // by the unit of the game's value
const [LEFT, RIGHT, TOP, BOTTOM] = [34, 8, 34, 18];
const WINDOW_S = 300;

export class Charts {
  constructor(element) {
    this.surfaces = CHARTS.map(([name]) => {
      const canvas = document.createElement("canvas");
      canvas.dataset.chart = name;
      canvas.setAttribute("role", "img");
      element.append(canvas);
      return new Surface(canvas);
    });
  }

  // `until_s` is the time at the right edge. A replay shows its whole length.
  show(daemon, window_s = WINDOW_S) {
    const { rows, columns } = daemon;
    const until = rows.at(-1)?.[0] ?? 0;
    const from = Math.max(rows[0]?.[0] ?? 0, until - window_s);
    const unit = daemon.scene?.unit ?? "s";
    const shown = rows.filter((row) => row[0] >= from);
    CHARTS.forEach(([name, curves], at) => {
      const surface = this.surfaces[at];
      if (!surface.begin()) return;
      const drawn = Object.entries(curves).filter(([column]) => column !== LEFT_OUT[unit]).map(([column, [colour, dash]]) => {
        const [index, factor] = [columns.indexOf(column), name === "age" ? 1000 : 1];
        const points = shown.map((row) => (row[index] === null ? null : [row[0], factor * row[index]]));
        return { column, colour: ink(colour), dash, points };
      });
      const title = TEXTS.charts[name][unit] ?? TEXTS.charts[name];
      const label = TEXTS.chart(title);
      if (surface.canvas.getAttribute("aria-label") !== label) surface.canvas.setAttribute("aria-label", label);
      this.chart(surface, title, drawn, [from, Math.max(until, from + 10)]);
    });
  }

  chart(surface, title, curves, [from, until]) {
    const { width, height } = surface;
    const values = curves.flatMap(({ points }) => points.filter(Boolean).map(([, value]) => value));
    const low = Math.min(0, ...values);
    const high = Math.max(low + 1, ...values) * 1.05;
    const x = (now) => LEFT + ((now - from) / (until - from)) * (width - LEFT - RIGHT);
    const y = (value) => height - BOTTOM - ((value - low) / (high - low)) * (height - TOP - BOTTOM);
    surface.font(11);
    const step = roundStep(high - low, 4);
    for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
      surface.line([[LEFT, y(value)], [width - RIGHT, y(value)]], ink("--grid"));
      surface.text(String(Number(value.toFixed(3))), LEFT - 4, y(value), ink("--faint"), "right");
    }
    const every = roundStep(until - from, 4);
    for (let now = Math.ceil(from / every) * every; now <= until; now += every) {
      surface.line([[x(now), TOP], [x(now), height - BOTTOM]], ink("--grid"));
      surface.text(`${Number(now.toFixed(1))} s`, x(now), height - 8, ink("--faint"), "center");
    }
    for (const { points, colour, dash } of curves) {
      surface.line(points.map((one) => one && [x(one[0]), y(one[1])]), colour, 1.8, dash);
    }
    this.legend(surface, title, curves);
  }

  legend(surface, title, curves) {
    surface.font(12, 700);
    surface.text(title, 6, 10, ink("--ink"));
    const beside = 16 + surface.context.measureText(title).width;
    surface.font(11);
    let [left, top] = [6, 25];
    for (const { column, colour, dash, points } of curves) {
      const last = points.at(-1)?.[1];
      const words = `${TEXTS.charts[column]}${last === undefined ? "" : ` ${fixed(last, last < 100 ? 1 : 0)}`}`;
      const long = surface.context.measureText(words).width;
      if (left + 19 + long > surface.width) [left, top] = [beside, 10]; // next line
      surface.line([[left, top], [left + 12, top]], colour, 2.5, dash);
      surface.text(words, left + 15, top, ink("--ink"));
      left += 22 + long;
    }
  }
}
