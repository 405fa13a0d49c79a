// Replay of a record in the live view, with a slider and without orders.
import { rowOf } from "./feed.js";
import { TEXTS } from "./texts.js";

const FRAMES_PER_ROW = 2;

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
    document.title = `${TEXTS.replay} · ${record}`;
    this.load(record);
  }

  async load(record) {
    this.say(TEXTS.loading);
    try {
      const answer = await fetch(`records/frames?record=${encodeURIComponent(record)}`);
      if (!answer.ok) throw new Error(await answer.text());
      const flight = await answer.json();
      if (flight.error) throw new Error(flight.error);
      this.begin(flight);
    } catch (error) {
      this.say(String(error));
    }
  }

  begin(flight) {
    this.flight = flight;
    flight.rows = flight.frames.filter((_, at) => at % FRAMES_PER_ROW === 0).map((frame) => rowOf(frame, flight.columns));
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
    at("banner").textContent = words;
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
    const { frames, rows, columns, events, scenes } = this.flight;
    const seen = frames[Number(at("moment").value)];
    if (!seen) return;
    at("moment-s").textContent = `${seen.now_s.toFixed(1)} s`;
    const scene = (scenes.findLast((one) => one.from_s <= seen.now_s) ?? scenes[0]).scene;
    const until = (list, time) => list.filter((one) => time(one) <= seen.now_s);
    this.pictures.draw(
      {
        scene, columns, snapshot: seen, status: {},
        rows: until(rows, (row) => row[0]), events: until(events, (event) => event.now_s),
      },
      Infinity,
    );
  }
}
