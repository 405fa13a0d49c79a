// The vehicles of a team: who belongs to it, a button for each, where the others are in the frame of the one that is
// shown, and promises.
import { lamp } from "./glance.js";
import { EVADER, PURSUER } from "./surface.js";
import { TEXTS } from "./texts.js";

const DEGREE_M = 111_320;
const SAME_M = 0.05;
const LEVELS = { kept: "ok", "at risk": "caution", lost: "warning" };

// All vehicles of a daemon's team that the page knows, by name; empty without a team.
export function teamOf(daemon, daemons) {
  const names = daemon?.status.vehicles ?? [];
  const team = daemons.filter((one) => one.endpoint === daemon?.endpoint && names.includes(one.name));
  return team.sort((one, other) => one.name.localeCompare(other.name));
}

// A button for each daemon: its name, its state and its evader. `choose` gets the key of the one that is pressed. A text
// says how many more there are.
export function showTabs(element, daemons, shown, choose, leftOut = 0) {
  const against = (one) => (one.status.assignment?.evader ? ` → ${one.status.assignment.evader}` : "");
  const bad = (one) => (one.fault ? ` · ${TEXTS.badData}` : "");
  const words = daemons.map((one) => `${one.name} · ${one.snapshot?.state_words ?? one.status.state ?? "–"}${against(one)}${bad(one)}`);
  const said = JSON.stringify([words, shown?.key, leftOut]);
  if (element.dataset.shown === said) return;
  element.dataset.shown = said;
  const tabs = daemons.map(({ key }, index) => {
    const button = document.createElement("button");
    button.className = "quiet";
    button.textContent = words[index];
    button.setAttribute("aria-pressed", key === shown?.key);
    button.addEventListener("click", () => choose(key));
    return button;
  });
  element.replaceChildren(...tabs, ...(leftOut ? [TEXTS.leftOut(daemons.length, leftOut)] : []));
}

// The daemons as players of one picture, the shown one first, with all places in its game frame.
export function playersOf(daemon, team = []) {
  const others = team.filter((one) => one !== daemon && one.snapshot);
  return [player(daemon, [0, 0], team.length > 1), ...others.map((one) => player(one, offset(one, daemon), true))];
}

function player(daemon, [east, north], named) {
  const { snapshot: seen, scene, status } = daemon;
  const same = Math.hypot(east, north) < SAME_M;
  const moved = (place) => (same || !place ? place : [place[0] + east, place[1] + north, ...place.slice(2)]);
  const movedIn = (row) => row.map((value, column) => ([PURSUER, EVADER].includes(column) ? moved(value) : value));
  const rows = same ? daemon.rows : daemon.rows.map(movedIn);
  const evader = status.assignment?.evader ?? "";
  return {
    scene, rows, seen, evader,
    name: named ? daemon.name : TEXTS.map.pursuer,
    evaderName: evader || TEXTS.map.evader,
    out: status.assignment?.over.includes(evader) ?? false,
    pursuer: moved(seen?.pursuer_m),
    target: moved(seen?.evader_m),
    meeting: moved(seen?.game?.meeting_m),
    isochron: seen?.game?.isochron_m?.map(moved),
  };
}

// What to add to a place of one daemon to have it in the frame of another: both know their home in degrees.
function offset({ scene: from }, { scene: to }) {
  if (!from?.home_deg || !to?.home_deg || !from.home_m || !to.home_m) return [0, 0];
  const [north, east] = [0, 1].map((axis) => (from.home_deg[axis] - to.home_deg[axis]) * DEGREE_M);
  const shrunk = east * Math.cos((to.home_deg[0] * Math.PI) / 180);
  return [shrunk + to.home_m[0] - from.home_m[0], north + to.home_m[1] - from.home_m[1]];
}

// A line for each promise: a lamp, its value, and who keeps it.
export function showPromises(element, daemon) {
  const { promises, over, coordinator } = daemon?.status.assignment ?? { promises: [] };
  const shown = JSON.stringify([promises, over, coordinator]);
  element.hidden = !coordinator;
  if (element.dataset.shown === shown) return;
  element.dataset.shown = shown;
  const sorted = [...promises].sort((one, other) => one.evader.localeCompare(other.evader));
  const lamps = sorted.map(({ evader, standing, words, first, second }) => {
    const line = document.createElement("span");
    const out = over.includes(evader);
    const by = [first, second].filter(Boolean).join(" + ");
    lamp(line, out ? "unknown" : LEVELS[standing], out ? TEXTS.out(evader) : `${evader}: ${words}${by && ` · ${by}`}`);
    return line;
  });
  const small = document.createElement("small");
  small.textContent = coordinator ? TEXTS.coordinator(coordinator) : "";
  element.replaceChildren(...lamps, small);
}
