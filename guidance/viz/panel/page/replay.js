// Replay of a record in the live view, with a slider and without orders. Of a team flight it shows all vehicles.
import { rowOf } from "./feed.js";
import { showTabs } from "./team.js";
import { TEXTS } from "./texts.js";

const FRAMES_PER_ROW = 2;
const ENDS = ["stand-off reached", "evader reached its target"]; // events after which an evader is out of play

const at = (name) => document.getElementById(name);

export class Replay {
  constructor(pictures, record) {
    this.pictures = pictures;
    this.flight = null;
    this.playing = false;
    window.panel = this;
    document.body.classList.add("replay");
    for (const name of ["orders", "by-label", "contact"]) at(name).hidden = true;
    at("mark").textContent = TEXTS.replay;
    at("play").textContent = TEXTS.play;
    document.title = `${TEXTS.replay} · ${printable(record)}`;
    this.load(record);
  }

  async load(record) {
    const begunMs = performance.now();
    const tell = () => this.say(TEXTS.loading((performance.now() - begunMs) / 1000));
    const telling = setInterval(tell, 1000);
    tell();
    try {
      const answer = await fetch(`records/frames?record=${encodeURIComponent(record)}`);
      if (!answer.ok) throw new Error(await answer.text());
      const flight = await answer.json();
      clearInterval(telling);
      if (flight.error) throw new Error(flight.error);
      this.begin(flight);
    } catch (error) {
      clearInterval(telling);
      this.say(String(error));
    }
  }

  begin(flight) {
    this.flight = flight;
    this.flights = [flight, ...flight.mates].filter((one) => one.frames?.length);
    this.flights.sort((one, other) => one.vehicle.localeCompare(other.vehicle));
    this.chosen = flight.vehicle;
    for (const one of this.flights) {
      one.rows = one.frames.filter((_, at) => at % FRAMES_PER_ROW === 0).map((frame) => rowOf(frame, one.columns));
      const ends = one.events.filter(({ event }) => ENDS.includes(event));
      one.ends = ends.map(({ now_s }) => ({ now_s, evader: frameAt(one, now_s).against }));
    }
    this.say("");
    at("daemons").textContent = flight.name;
    at("slider").hidden = false;
    const moment = at("moment");
    moment.max = flight.frames.length - 1;
    moment.addEventListener("input", () => this.draw());
    at("play").addEventListener("click", () => this.play(!this.playing));
    const first = flight.frames.findIndex((frame) => frame.game);
    moment.value = Math.max(0, first);
    this.draw();
  }

  say(words) {
    at("banner").hidden = !words;
    at("banner").className = "unknown";
    at("warning").textContent = words;
  }

  // Plays in real time.
  play(on) {
    this.playing = on;
    at("play").textContent = on ? TEXTS.pause : TEXTS.play;
    if (!on) return;
    const { frames } = this.flight;
    const [begunMs, from_s] = [performance.now(), frames[Number(at("moment").value)].now_s];
    const step = () => {
      if (!this.playing) return;
      const now_s = from_s + (performance.now() - begunMs) / 1000;
      const next = frames.findIndex((frame) => frame.now_s >= now_s);
      at("moment").value = next < 0 ? frames.length - 1 : next;
      this.draw();
      if (next < 0) this.play(false);
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  draw() {
    if (!this.flight) return;
    const { now_s } = this.flight.frames[Number(at("moment").value)] ?? {};
    if (now_s === undefined) return;
    at("moment-s").textContent = `${now_s.toFixed(1)} s`;
    const over = this.flights.flatMap(({ ends }) => ends.filter((one) => one.now_s <= now_s).map(({ evader }) => evader));
    const vehicles = this.flights.map((one) => moment(one, now_s, over.filter(Boolean)));
    const shown = vehicles.find((one) => one.key === this.chosen);
    const team = vehicles.length > 1 ? vehicles : [];
    if (team.length) {
      showTabs(at("daemons"), team, shown, (key) => {
        this.chosen = key;
        this.pictures.shown.fit();
        this.draw();
      });
    }
    this.pictures.draw(shown, Infinity, team);
  }
}

// Without characters that control the direction of the text: a name could reverse the words beside it.
const printable = (words) => words.replace(/[\p{Cc}\p{Cf}]/gu, "");

const frameAt = ({ frames }, now_s) => frames.findLast((frame) => frame.now_s <= now_s) ?? frames[0];

// A flight at a time, in the form of a daemon; `over` are the evaders out of play.
function moment(flight, now_s, over) {
  const { vehicle, scenes, columns, rows, events } = flight;
  const seen = frameAt(flight, now_s);
  return {
    key: vehicle, name: vehicle, columns, snapshot: seen, status: { assignment: { evader: seen.against, over } },
    scene: (scenes.findLast((one) => one.from_s <= now_s) ?? scenes[0]).scene,
    rows: rows.filter((row) => row[0] <= now_s), events: events.filter((event) => event.now_s <= now_s),
  };
}
