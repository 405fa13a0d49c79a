// The plan view, to scale: x east, y north, m. It shows everything until the user zooms or drags.
import { EVADER, PURSUER, Surface, ink, roundStep } from "./surface.js";
import { TEXTS } from "./texts.js";
import { playersOf } from "./team.js";
import { Tiles } from "./tiles.js";

const LEAST_M = 30;
const MARGIN_PX = 34;
const JUMP_M = 15; // a track that jumps farther belongs to another evader from there on

export class Plan {
  constructor(canvas) {
    this.surface = new Surface(canvas);
    this.tiles = new Tiles(() => this.draw());
    this.framing = true;
    this.framed = false;
    this.centre = [0, 0];
    this.scale = 5; // pixels per metre
    this.daemon = null;
    steer(canvas, {
      drag: (dx, dy) => this.move(dx, dy),
      zoom: (factor, at) => this.zoom(factor, at),
      fit: () => this.fit(),
    });
  }

  show(daemon, team) {
    [this.daemon, this.team] = [daemon, team];
    this.draw();
  }

  fit() {
    [this.framing, this.framed] = [true, false];
    this.draw();
  }

  move(dx, dy) {
    this.framing = false;
    this.centre = [this.centre[0] - dx / this.scale, this.centre[1] + dy / this.scale];
    this.draw();
  }

  zoom(factor, at = [this.surface.width / 2, this.surface.height / 2]) {
    this.framing = false;
    const [x, y] = this.ground(at);
    this.scale = Math.min(400, Math.max(0.01, this.scale * factor));
    const [px, py] = this.pixel([x, y]);
    this.centre = [this.centre[0] + (px - at[0]) / this.scale, this.centre[1] - (py - at[1]) / this.scale];
    this.draw();
  }

  pixel([x, y]) {
    const { width, height } = this.surface;
    return [width / 2 + (x - this.centre[0]) * this.scale, height / 2 - (y - this.centre[1]) * this.scale];
  }

  ground([px, py]) {
    const { width, height } = this.surface;
    return [this.centre[0] + (px - width / 2) / this.scale, this.centre[1] - (py - height / 2) / this.scale];
  }

  draw() {
    if (!this.surface.begin() || !this.daemon) return;
    const { scene } = this.daemon;
    const players = playersOf(this.daemon, this.team);
    if (this.framing) this.frame(players.flatMap((one) => this.worth(one)));
    if (scene?.home_deg && scene.home_m) this.tiles.draw(this, scene);
    this.grid();
    if (scene) this.still(scene);
    for (const { rows } of players) {
      for (const [from, colour, dash] of [[EVADER, "--evader", [6, 4]], [PURSUER, "--pursuer", []]]) {
        this.surface.line(track(rows, from).map((place) => onScreen(this, place)), ink(colour), 2, dash);
      }
    }
    this.moving(players);
    if (!players.some((one) => one.pursuer)) this.surface.text(TEXTS.map.wait, this.surface.width / 2, 24, ink("--faint"), "center");
    this.scaleBar();
  }

  // Points to show of a vehicle: both players, meeting point, disc, home, and the recent part of the tracks.
  worth({ pursuer, target, meeting, scene, rows }) {
    const places = [pursuer, target, meeting, this.daemon.scene?.home_m, this.daemon.scene?.target_m].filter(Boolean);
    const radius = scene?.standoff_m.radius ?? 0;
    if (target) for (const by of [-radius, radius]) places.push([target[0] + by, target[1] + by]);
    for (const row of rows.slice(-240)) for (const from of [PURSUER, EVADER]) places.push(row[from]);
    return places.filter(Boolean);
  }

  frame(places) {
    if (!places.length) return;
    const [xs, ys] = [places.map(([x]) => x), places.map(([, y]) => y)];
    const [west, east, south, north] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const { width, height } = this.surface;
    const wide = Math.max(east - west, LEAST_M) / Math.max(40, width - 2 * MARGIN_PX);
    const high = Math.max(north - south, LEAST_M) / Math.max(40, height - 2 * MARGIN_PX);
    const wanted = 1 / Math.max(wide, high);
    // Change the view only if a point leaves it, or if everything is far too small.
    const centre = [(west + east) / 2, (south + north) / 2];
    const kept = this.framed && places.every((place) => this.isInside(place)) && wanted / this.scale < 1.6;
    if (!kept) [this.scale, this.centre, this.framed] = [0.9 * wanted, centre, true];
  }

  isInside(place) {
    const [px, py] = this.pixel(place);
    const { width, height } = this.surface;
    return px > 12 && py > 12 && px < width - 12 && py < height - 12;
  }

  grid() {
    const { width, height } = this.surface;
    const step = roundStep(width / this.scale, 8);
    const [west, north] = this.ground([0, 0]);
    const [east, south] = this.ground([width, height]);
    for (let x = Math.ceil(west / step) * step; x < east; x += step) {
      const px = this.pixel([x, 0])[0];
      this.surface.line([[px, 0], [px, height]], ink("--grid"));
    }
    for (let y = Math.ceil(south / step) * step; y < north; y += step) {
      const py = this.pixel([0, y])[1];
      this.surface.line([[0, py], [width, py]], ink("--grid"));
    }
  }

  still(scene) {
    const { surface } = this;
    for (const edge of scene.fence_m) {
      surface.line(edge.map((place) => this.pixel(place)), ink("--fence"), 2.5, [10, 5]);
      const top = edge.reduce((best, one) => (one[1] > best[1] ? one : best));
      const [x, y] = this.pixel(top);
      surface.text(TEXTS.map.fence, x, y - 9, ink("--fence"), "center");
    }
    if (scene.home_m) {
      const [x, y] = this.pixel(scene.home_m);
      surface.fill([[x - 8, y + 8], [x - 8, y - 2], [x, y - 10], [x + 8, y - 2], [x + 8, y + 8]], ink("--faint"));
      surface.context.textAlign = "center";
      surface.context.fillStyle = ink("--card");
      surface.context.fillText(TEXTS.map.home, x, y + 2);
    }
    if (scene.target_edge_m?.length) surface.line(scene.target_edge_m.map((place) => this.pixel(place)), ink("--ink"), 2);
    if (scene.target_m) {
      const [x, y] = this.pixel(scene.target_m);
      surface.line([[x - 9, y], [x + 9, y], null, [x, y - 9], [x, y + 9]], ink("--ink"), 2.5);
      surface.text(TEXTS.map.target, x + 11, y - 9, ink("--ink"));
    }
  }

  moving(players) {
    const { surface } = this;
    const evaders = new Map(players.filter((one) => one.target).map((one) => [one.evaderName, one]));
    for (const [name, { target, scene, out }] of evaders) {
      const curves = players.filter((one) => one.evaderName === name && one.isochron?.length);
      const paths = curves.map((one) => one.isochron.map((place) => this.pixel(place)));
      if (paths.length > 1) surface.fillCommon(paths, ink("--isochron"), 0.22); // reached before all of its vehicles
      for (const path of paths) surface.line(path, ink("--isochron"), 1.5, [2, 4]);
      if (scene && !out) {
        const rim = circle(this.pixel(target), scene.standoff_m.radius * this.scale);
        surface.fill(rim, ink("--disc"), 0.16);
        surface.line(rim, ink("--disc"), 2.5);
      }
    }
    for (const { meeting, pursuer, target, scene } of players) {
      if (!meeting || !pursuer || !target) continue;
      const at = this.pixel(meeting);
      surface.line([this.pixel(pursuer), at, null, this.pixel(target), at], ink("--meeting"), 1.5, [5, 4]);
      surface.star(at, 9, ink("--meeting"));
      surface.text(TEXTS.map.meeting[scene?.unit ?? "s"], at[0] + 12, at[1] - 4, ink("--meeting"));
    }
    for (const [name, { target, out }] of evaders) {
      const [x, y] = this.pixel(target);
      surface.fill([[x - 7, y], [x, y - 7], [x + 7, y], [x, y + 7]], ink("--evader"), out ? 0.4 : 1);
      surface.text(out ? TEXTS.out(name) : name, x + 8, y + 15, ink("--evader"));
    }
    // The shown vehicle is drawn last, above the others.
    for (const { pursuer, target, seen, name } of [...players].reverse()) {
      if (pursuer) this.vehicle(this.pixel(pursuer), seen.yaw_rad ?? 0, target && this.pixel(target), name);
    }
  }

  // The label is on the side away from the evader.
  vehicle([x, y], yaw, evader, name) {
    const turned = (right, ahead) => [
      x + right * Math.cos(yaw) + ahead * Math.sin(yaw),
      y + right * Math.sin(yaw) - ahead * Math.cos(yaw),
    ];
    const shape = [turned(0, 13), turned(9, -10), turned(0, -5), turned(-9, -10)];
    this.surface.fill(shape, ink("--pursuer"));
    this.surface.line([...shape, shape[0]], ink("--card"), 1.5);
    this.surface.font(13, 700);
    const [right, above] = evader ? [evader[0] < x, evader[1] > y] : [true, true];
    this.surface.text(name, x + (right ? 14 : -14), y + (above ? -12 : 14), ink("--pursuer"), right ? "left" : "right");
    this.surface.font(12);
  }

  scaleBar() {
    const { surface } = this;
    const length = roundStep(160 / this.scale, 1.6);
    const [x, y] = [12, surface.height - 14];
    const far = x + length * this.scale;
    surface.line([[x, y - 5], [x, y], [far, y], [far, y - 5]], ink("--ink"), 2);
    surface.text(`${length} m`, far + 6, y - 3, ink("--ink"));
    const north = [surface.width - 20, 34];
    surface.fill([[north[0], 8], [north[0] + 6, 24], [north[0] - 6, 24]], ink("--ink"));
    surface.text(TEXTS.map.north, ...north, ink("--ink"), "center");
  }
}

// A track of the history, broken where it jumps.
export function track(rows, from) {
  const places = rows.map((row) => row[from]);
  const jumps = (one, other) => one && other && Math.hypot(one[0] - other[0], one[1] - other[1]) > JUMP_M;
  return places.flatMap((place, at) => (jumps(place, places[at - 1]) ? [null, place] : [place]));
}

const onScreen = (plan, place) => (place === null ? null : plan.pixel(place));

export function circle([x, y], radius, points = 72) {
  return [...Array(points + 1).keys()].map((at) => {
    const turn = (2 * Math.PI * at) / points;
    return [x + radius * Math.cos(turn), y + radius * Math.sin(turn)];
  });
}

const KEY_STEP_PX = 40;
const KEY_ZOOM = 1.5;
const ARROWS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

// The keyboard moves as a drag does: arrows move, + and − zoom, 0 shows everything again.
function steerByKeys(canvas, { drag, zoom, fit }) {
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = ARROWS[event.key];
    if (arrow) drag(KEY_STEP_PX * arrow[0], KEY_STEP_PX * arrow[1]);
    else if (["+", "="].includes(event.key)) zoom(KEY_ZOOM);
    else if (["-", "−"].includes(event.key)) zoom(1 / KEY_ZOOM);
    else if (event.key === "0") fit();
    else return;
    event.preventDefault();
  });
}

// One pointer drags; two pointers or the wheel zoom; keys do both.
export function steer(canvas, actions) {
  const { drag, zoom } = actions;
  steerByKeys(canvas, actions);
  const held = new Map();
  const spread = () => {
    const [one, other] = [...held.values()];
    return { apart: Math.hypot(one[0] - other[0], one[1] - other[1]), middle: [(one[0] + other[0]) / 2, (one[1] + other[1]) / 2] };
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, [event.offsetX, event.offsetY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = held.get(event.pointerId);
    if (!last) return;
    const before = held.size === 2 ? spread() : null;
    held.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (before) {
      const after = spread();
      if (before.apart > 0) zoom(after.apart / before.apart, after.middle);
    } else drag(event.offsetX - last[0], event.offsetY - last[1]);
  });
  for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => held.delete(event.pointerId));
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      zoom(Math.exp(-0.0015 * event.deltaY), [event.offsetX, event.offsetY]);
    },
    { passive: false },
  );
}
