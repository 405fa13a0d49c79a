// State in large letters, lamps (word, shape and colour), and the last events.
import { fixed } from "./surface.js";
import { TEXTS } from "./texts.js";

export function lamp(element, level, words) {
  element.className = `${element.classList.contains("big") ? "lamp big" : "lamp"} ${level}`;
  element.dataset.shape = TEXTS.shapes[level];
  element.textContent = words;
  element.title = TEXTS.levels[level];
}

const number = (value, digits, unit) => (value === null || value === undefined ? "–" : `${fixed(value, digits)} ${unit}`);
const aged = (value) => (value === null || value === undefined ? TEXTS.never : TEXTS.ago(value));

// Each line: name, level (null: a plain value), text.
function lines({ snapshot: seen, scene, status, operator }) {
  const { age_s: age, game, levels, alarm } = seen;
  const battery = seen.battery === null ? TEXTS.unknown : `${Math.round(100 * seen.battery)} %`;
  const above = seen.pursuer_m && scene?.home_m ? seen.pursuer_m[2] - scene.home_m[2] : null;
  const rows = [
    ["battery", levels.battery, battery],
    ["heartbeat", levels.heartbeat, aged(age.heartbeat)],
    ["position", levels.position, aged(age.position)],
    ["evader", levels.evader, aged(age.evader)],
    ["source", null, seen.source || "–"],
    ["stream", levels.stream, seen.streaming ? TEXTS.streaming : TEXTS.silent],
    ["altitude", null, number(above, 1, "m")],
    ["speed", null, number(seen.speed_m_s.flown, 1, "m/s")],
  ];
  if (game) rows.push(...played(game, levels, scene));
  if (seen.gap_m !== null) rows.push(["range", null, number(seen.gap_m, 1, "m")], ["height", null, number(seen.height_gap_m, 1, "m")]);
  if (game) rows.push(["limits", levels.limits, game.limits.length ? game.limits.join(", ") : TEXTS.none]);
  if (alarm) rows.push(["alarm", "warning", `${alarm.what} (${alarm.amount.toFixed(1)})`]);
  if (operator) rows.push(["operator", operator.level, TEXTS.operatorSeen(operator.silence_s, operator.limit_s)]);
  if (status.recording) rows.push(["recording", recorded(status.recording), status.recording]);
  return rows;
}

function played(game, levels, scene) {
  const unit = scene?.unit ?? "s";
  const winner = game.no_game ? TEXTS.noGame : TEXTS.wins[game.wins];
  const rows = [
    ["winner", levels.winner, winner],
    ["value", null, `${number(game.value, 1, "")}${TEXTS.valueUnits[unit]}`],
    ["need", null, number(game.time_needed_s, 1, "s")],
    ["reaches", null, number(game.reachable_m_s, 1, "m/s")],
  ];
  if (unit === "m") rows.push(["margin", null, `${number(game.vehicle_margin_s, 1, "s")}${TEXTS.ideal(number(game.margin_s, 1, "s"))}`], ["assured", null, number(game.assured_m, 1, "m")]);
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
      mode.textContent = status.waiting_for ? TEXTS.waiting(status.waiting_for) : "";
      this.fill([]);
    } else {
      lamp(state, seen.levels.state, seen.state);
      mode.textContent = `${seen.armed ? TEXTS.armed : TEXTS.disarmed} · ${seen.mode}`;
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
