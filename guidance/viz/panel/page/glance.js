// State in large letters, lamps (word, shape and colour), and the last events.
import { fixed } from "./surface.js";
import { TEXTS } from "./texts.js";

// Writes only what has changed: a screen reader says each change of a live region.
export function lamp(element, level, words) {
  const looks = `${element.classList.contains("big") ? "lamp big" : "lamp"} ${level}`;
  if (element.className !== looks) {
    element.className = looks;
    element.dataset.shape = TEXTS.shapes[level];
    element.title = TEXTS.levels[level];
  }
  write(element, words);
}

export function write(element, words) {
  if (element.textContent !== words) element.textContent = words;
}

const isKnown = (value) => value !== null && value !== undefined;
const number = (value, digits, unit) => (isKnown(value) ? `${fixed(value, digits)} ${unit}` : "–");
const aged = (value) => (isKnown(value) ? TEXTS.ago(value) : TEXTS.never);
const joined = (...parts) => parts.filter(Boolean).join(" · ") || TEXTS.unknown;
const percent = (share) => isKnown(share) && `${Math.round(100 * share)} %`;
const clock = (s) => `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, "0")}`;
const heading = (rad) => `${String(Math.round((rad * 180) / Math.PI + 360) % 360).padStart(3, "0")}°`;

// Each line: name, level (null: a plain value), text.
function lines({ snapshot: seen, scene, status, operator }) {
  const { age_s: age, game, gps, levels, alarm } = seen;
  const above = seen.pursuer_m && scene?.home_m ? seen.pursuer_m[2] - scene.home_m[2] : null;
  const rows = [...(game ? played(game, levels, scene) : [])];
  if (seen.gap_m !== null) rows.push(["range", null, number(seen.gap_m, 1, "m")], ["height", null, number(seen.height_gap_m, 1, "m")]);
  rows.push(
    ["altitude", null, number(above, 1, "m")],
    ["speed", null, number(seen.speed_m_s.flown, 1, "m/s")],
    ["heading", null, isKnown(seen.yaw_rad) ? heading(seen.yaw_rad) : "–"],
    ["flight", null, isKnown(seen.flight_s) ? clock(seen.flight_s) : "–"],
    ["battery", levels.battery, joined(percent(seen.battery), isKnown(seen.voltage_v) && number(seen.voltage_v, 1, "V"))],
    ["gps", levels.gps, gps ? joined(TEXTS.fixes[gps.fix] ?? TEXTS.fixes[0], isKnown(gps.satellites) && TEXTS.satellites(gps.satellites)) : TEXTS.unknown],
    ["link", levels.link, joined(percent(seen.link), isKnown(age.round_trip) && `${Math.round(1000 * age.round_trip)} ms`)],
    ["heartbeat", levels.heartbeat, aged(age.heartbeat)],
    ["position", levels.position, aged(age.position)],
    ["evader", levels.evader, aged(age.evader)],
    ["source", null, seen.source || "–"],
    ["stream", levels.stream, seen.streaming ? TEXTS.streaming : TEXTS.silent],
  );
  if (game) rows.push(["limits", levels.limits, game.active_limits.length ? game.active_limits.join(", ") : TEXTS.none]);
  if (alarm) rows.unshift(["alarm", "warning", `${alarm.what} (${alarm.amount.toFixed(1)})`]);
  if (operator) rows.push(["operator", operator.level, TEXTS.operatorSeen(operator.silence_s, operator.limit_s)]);
  if (status.recording) rows.push(["recording", recorded(status.recording), status.recording]);
  return rows;
}

function played(game, levels, scene) {
  const rows = [["reach", levels.reach, TEXTS.reach(game.reach, game.time_needed_s)], ["reaches", null, number(game.reachable_speed_m_s, 1, "m/s")]];
  if (scene?.unit === "m") rows.push(["assured", null, number(game.assured_distance_m, 1, "m")], ["margin", null, number(game.vehicle_margin_s, 1, "s")]);
  return rows;
}

const recorded = (said) => (said === "on" ? "ok" : said === "off" ? "unknown" : "caution");

export class Glance {
  constructor() {
    this.cells = new Map();
    this.list = document.querySelector("#lamps");
    this.events = document.querySelector("#events");
    this.shownEvents = null;
  }

  show(daemon) {
    const { snapshot: seen, status } = daemon;
    const state = document.querySelector("#state");
    const mode = document.querySelector("#mode");
    if (!seen) {
      lamp(state, "caution", status.state ?? "–");
      write(mode, status.waiting_for ? TEXTS.waiting(status.waiting_for) : "");
      this.fill([]);
    } else {
      lamp(state, seen.levels.state, seen.state_words);
      write(mode, `${seen.armed ? TEXTS.armed : TEXTS.disarmed} · ${seen.mode}`);
      this.fill(lines(daemon));
    }
    this.tell(daemon.events);
  }

  fill(rows) {
    const names = rows.map(([name]) => name).join();
    if (names !== this.names) {
      this.names = names;
      this.cells.clear();
      this.list.replaceChildren(...rows.flatMap(([name]) => this.made(name)));
    }
    rows.forEach(([name, level, words], at) => {
      const cell = this.list.children[2 * at + 1].firstChild;
      if (cell.textContent !== words || !cell.classList.contains(level ?? "plain")) {
        if (level) lamp(cell, level, words);
        else {
          cell.className = "plain";
          cell.textContent = words;
        }
      }
      cell.dataset.name = name;
    });
  }

  made(name) {
    const term = document.createElement("dt");
    const given = document.createElement("dd");
    term.textContent = TEXTS.lamps[name];
    given.append(document.createElement("span"));
    return [term, given];
  }

  tell(events) {
    if (events === this.shownEvents) return;
    this.shownEvents = events;
    this.events.replaceChildren(
      ...events.slice(-60).reverse().map((event) => {
        const line = document.createElement("li");
        const time = document.createElement("time");
        time.textContent = `${event.now_s.toFixed(1)} s`;
        line.append(time, `${event.event}${event.detail ? ": " + event.detail : ""}`);
        return line;
      }),
    );
  }
}
