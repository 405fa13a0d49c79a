// The page: receives data, shows one of the daemons, and sends it orders.
import { Charts } from "./charts.js";
import { Feed, askPanel } from "./feed.js";
import { Glance, lamp, write } from "./glance.js";
import { Orders } from "./orders.js";
import { Plan } from "./plan.js";
import { Profile } from "./profile.js";
import { Records, link } from "./records.js";
import { Replay } from "./replay.js";
import { Space } from "./space.js";
import { forgetInks } from "./surface.js";
import { showPromises, showTabs, teamOf } from "./team.js";
import { TEXTS } from "./texts.js";

const CHARTS_EVERY_MS = 500;
const MOST_TIMED = 600;
const SIGN_OF_LIFE_MS = 1000;
const at = (name) => document.getElementById(name);

// All drawings of one daemon, live or from a record.
class Pictures {
  constructor() {
    this.chartsMs = 0;
    this.glance = new Glance();
    this.plan = new Plan(at("plan"));
    this.space = new Space(at("space"));
    this.profile = new Profile(at("profile"));
    this.charts = new Charts(at("charts"));
  }

  get shown() {
    return at("plan").hidden ? this.space : this.plan;
  }

  draw(daemon, window_s, team = []) {
    this.glance.show(daemon);
    this.shown.show(daemon, team);
    this.profile.show(daemon);
    if (performance.now() - this.chartsMs > CHARTS_EVERY_MS || window_s) {
      this.chartsMs = performance.now();
      this.charts.show(daemon, window_s);
    }
  }
}

class Live {
  constructor(pictures, lookOnly, records) {
    this.records = records;
    this.chosen = null;
    this.waiting = false;
    this.lostFor = "";
    this.broken = "";
    this.timed = []; // when each cycle was drawn: [time of the cycle, s; clock of this computer, ms]
    this.pictures = pictures;
    this.orders = new Orders(at("orders"), lookOnly);
    at("mark").textContent = lookOnly ? TEXTS.look : "";
    at("by-label").hidden = lookOnly;
    this.feed = new Feed(() => this.changed(), (reason) => this.lost(reason));
    window.panel = this;
    if (!lookOnly) setInterval(() => this.sendSignOfLife(), SIGN_OF_LIFE_MS);
  }

  // An operator's sign of life to the shown daemon, or to its whole team, while this page is visible.
  sendSignOfLife() {
    if (!this.daemon || document.visibilityState !== "visible") return;
    for (const { key } of this.team.length ? this.team : [this.daemon]) this.feed.say(key);
  }

  get team() {
    return teamOf(this.daemon, [...this.feed.daemons.values()]);
  }

  get daemon() {
    const names = [...this.feed.daemons.keys()].sort();
    return this.feed.daemons.get(this.chosen) ?? this.feed.daemons.get(names[0]);
  }

  changed() {
    this.lostFor = "";
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  lost(reason) {
    this.lostFor = reason;
    this.orders.lose(TEXTS.noContact);
    this.banner();
  }

  draw() {
    const { daemon } = this;
    this.tabs(daemon);
    this.banner();
    if (!daemon) {
      this.orders.lose(TEXTS.noDaemon);
      return;
    }
    const { team } = this;
    this.orders.show(daemon, team);
    try {
      showPromises(at("promises"), daemon);
      this.pictures.draw(daemon, undefined, team);
      this.broken = "";
    } catch (error) {
      this.broken = String(error); // of this daemon's data: the others can be chosen as before
    }
    const drawn_s = daemon.snapshot?.now_s;
    if (drawn_s === undefined || drawn_s === this.drawn_s) return;
    this.drawn_s = drawn_s;
    requestAnimationFrame(() => this.shown(drawn_s)); // the drawing is on the screen when the next frame begins
  }

  shown(drawn_s) {
    this.timed.push([drawn_s, performance.timeOrigin + performance.now()]);
    if (this.timed.length > MOST_TIMED) this.timed.shift();
  }

  tabs(daemon) {
    const daemons = [...this.feed.daemons.values()];
    daemons.sort((one, other) => one.name.localeCompare(other.name));
    const choose = (key) => {
      this.chosen = key;
      this.pictures.shown.fit();
      this.draw();
    };
    showTabs(at("daemons"), daemons, daemon, choose, this.feed.leftOut);
    if (daemon?.over) lamp(at("contact"), "unknown", TEXTS.isOver);
    else if (daemon) lamp(at("contact"), daemon.contact, TEXTS.contact[daemon.contact]);
    else lamp(at("contact"), "unknown", TEXTS.noDaemon);
    const title = daemon ? `${daemon.name} · ${TEXTS.title}` : TEXTS.title;
    if (document.title !== title) document.title = title;
  }

  // Old data must not look current.
  banner() {
    const { daemon } = this;
    let words = "";
    let since = "";
    const over = daemon?.over;
    if (this.lostFor) words = TEXTS.panelLost[this.lostFor];
    else if (!daemon) words = this.feed.buses.map((bus) => TEXTS.looking(bus.endpoint, bus.reason)).join(" ");
    else if (over) words = TEXTS.over(over.ended, over.record);
    else if (daemon.contact === "warning") [words, since] = [TEXTS.daemonGone, TEXTS.silentFor(Math.round(daemon.silent_s))];
    else if (daemon.fault || this.broken) words = TEXTS.faulty(daemon.name, daemon.fault || this.broken);
    if (this.lostFor) lamp(at("contact"), "warning", TEXTS.contact.warning);
    const banner = at("banner");
    banner.hidden = !words;
    if (banner.dataset.words !== words) {
      banner.dataset.words = words;
      at("warning").textContent = words;
      if (over?.replay && !this.lostFor && this.records) at("warning").append(link(TEXTS.replayIt, "replay", over.replay));
    }
    write(at("since"), since); // not in the live region: it changes every second
    banner.className = (daemon && !over) || this.lostFor ? "warning" : "unknown";
    document.body.classList.toggle("old", Boolean(this.lostFor) || (!over && daemon?.contact === "warning"));
  }
}

function dress(redraw) {
  const root = document.documentElement;
  const wanted = localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  const wear = (theme) => {
    root.dataset.theme = theme;
    at("theme").textContent = theme === "dark" ? TEXTS.light : TEXTS.dark;
    forgetInks();
  };
  wear(wanted);
  at("theme").addEventListener("click", () => {
    const theme = root.dataset.theme === "dark" ? "light" : "dark";
    localStorage.setItem("theme", theme);
    wear(theme);
    redraw();
  });
}

function switchViews(page, pictures) {
  const show = (plan) => {
    at("plan").hidden = !plan;
    at("space").hidden = plan;
    at("show-plan").setAttribute("aria-pressed", plan);
    at("show-space").setAttribute("aria-pressed", !plan);
    page.draw();
  };
  at("show-plan").addEventListener("click", () => show(true));
  at("show-space").addEventListener("click", () => show(false));
  at("zoom-in").addEventListener("click", () => pictures.shown.zoom(1.5));
  at("zoom-out").addEventListener("click", () => pictures.shown.zoom(1 / 1.5));
  at("fit").addEventListener("click", () => pictures.shown.fit());
  show(true);
}

function label() {
  for (const [name, words] of [
    ["title", TEXTS.heading], ["show-plan", TEXTS.plan], ["show-space", TEXTS.space], ["fit", TEXTS.fit],
    ["records-button", TEXTS.records], ["invite", TEXTS.invite],
  ]) at(name).textContent = words;
  for (const [name, words] of Object.entries(TEXTS.names)) at(name).setAttribute("aria-label", words);
  at("by-label").firstElementChild.textContent = TEXTS.by;
  at("by").value = localStorage.getItem("by") ?? TEXTS.byDefault;
  at("by").addEventListener("change", () => localStorage.setItem("by", at("by").value));
}

const record = location.pathname.endsWith("/replay") ? new URLSearchParams(location.search).get("record") : null;
label();
const { look, records, tiles } = await (await askPanel()).json();
document.documentElement.dataset.tiles = tiles;
const pictures = new Pictures();
const page = record === null ? new Live(pictures, look, records) : new Replay(pictures, record);
if (records && record === null) new Records(at("records"), at("records-button"));
else at("records-button").hidden = true;
dress(() => page.draw());
switchViews(page, pictures);
window.addEventListener("resize", () => page.draw());
