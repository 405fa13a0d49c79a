// Orders. The daemon accepts or refuses them, and the page shows its answer. START, ENGAGE and ABORT need a press of 1 s,
// and so does each key: typed text orders nothing.
import { TEXTS } from "./texts.js";

const HOLD_MS = 1000;
const LOOKS = { start: "go", engage: "go", hold: "stop", land: "stop", abort: "last" };
const SLOW = new Set(["start", "engage", "abort"]);
const KEYS = { h: "hold", l: "land" };
const PRESSING = [" ", "Enter"];
const ALWAYS = ["hold", "land", "return", "abort"];
const TOGETHER = new Set(["start", "engage"]); // given to a team only if every vehicle accepts

// The next order in each state. The daemon's `refused_orders` gives the reason if it would refuse it.
const NEXT = {
  connecting: "start", checking: "start", ready: "start", waiting: "start", "standing by": "engage", holding: "engage",
  landed: "reset", yielded: "reset", failed: "reset",
};
const FIRST = ["start", "engage", "reset"]; // of vehicles in different states

export class Orders {
  constructor(element, lookOnly) {
    this.next = element.querySelector("#next");
    this.mainOrder = element.querySelector("#main-order");
    this.answer = element.querySelector("#answer");
    this.lookOnly = lookOnly;
    this.whom = element.querySelector("#whom");
    this.daemon = null;
    this.team = [];
    this.toAll = false;
    this.shown = "";
    this.pressed = ""; // the order whose button is pressed; the button is not replaced meanwhile
    if (lookOnly) return;
    this.holdAll = this.button("hold", true);
    this.always = ALWAYS.map((order) => this.button(order));
    const bar = element.querySelector("#buttons");
    bar.append(this.holdAll, ...this.always);
    this.holdAll.hidden = true; // until a team is known
    this.lose(TEXTS.noDaemon);
    this.listen();
    // On a phone the bar covers the end of the page: the page keeps that much room, also when it scrolls to something.
    new ResizeObserver(() => document.documentElement.style.setProperty("--bar", `${bar.offsetHeight}px`)).observe(bar);
  }

  show(daemon, team) {
    [this.daemon, this.team] = [daemon, team];
    this.choose();
    const targets = this.toAll ? team : [daemon];
    this.always?.forEach((button) => disable(button, against(targets, button.dataset.order)));
    if (this.holdAll) {
      this.holdAll.hidden = !team.length;
      disable(this.holdAll, against(team, "hold"));
    }
    const gone = targets.every(lost) && lost(daemon);
    const nexts = targets.map((one) => NEXT[stateOf(one)]);
    const order = gone || nexts.includes(undefined) ? undefined : FIRST.find((one) => nexts.includes(one));
    const reason = order ? against(targets, order) : "";
    const about = gone || this.about(targets);
    const lists = targets.map(({ status }) => [status.to_do, status.waiting_for]);
    const what = JSON.stringify([targets.map((one) => one.key), nexts, order, reason, lists, about]);
    if (what === this.shown) return;
    const blocked = order !== "reset" && (reason || targets.some((one) => !one.status.refused_orders));
    if (this.pressed && this.pressed === order && !blocked) return;
    this.shown = what;
    const parts = [];
    const buttons = order && !blocked && !this.lookOnly ? [this.button(order)] : [];
    if (order && !blocked && this.lookOnly) parts.push(said("p", TEXTS.awaits(TEXTS.orders[order][0])));
    else if (order && !blocked) parts.push(said("p", TEXTS.ready[order] ?? ""));
    else if (order) parts.push(...this.missing(order, targets, reason));
    else parts.push(said("p", about));
    if (order === "start") parts.push(...this.listed(toDo(targets), "warn", TEXTS.advised, "caution"));
    this.next.replaceChildren(...parts);
    this.mainOrder.replaceChildren(...buttons);
  }

  // What guidance does next; of a team with the names of those that do it.
  about(targets) {
    const doing = new Map();
    for (const one of targets) {
      const after = one.status.after_capture in TEXTS.after ? one.status.after_capture : "hold";
      const words = TEXTS.about[stateOf(one)]?.(after);
      if (words) doing.set(words, [...(doing.get(words) ?? []), one.name]);
    }
    const named = ([words, names]) => (this.toAll ? `${names.join(", ")}: ${words}` : words);
    return [...doing].map(named).join(" ");
  }

  // The choice between one vehicle and all of its team.
  choose() {
    this.whom.hidden = !this.team.length;
    this.toAll &&= this.team.length > 0;
    const shown = JSON.stringify([this.daemon.name, this.team.length, this.toAll]);
    if (this.whom.dataset.shown === shown) return;
    this.whom.dataset.shown = shown;
    const choices = [[this.daemon.name, false], [TEXTS.all(this.team.length), true]].map(([words, toAll]) => {
      const button = said("button", words);
      button.className = "quiet";
      button.setAttribute("aria-pressed", this.toAll === toAll);
      button.addEventListener("click", () => {
        this.toAll = toAll;
        this.show(this.daemon, this.team);
      });
      return button;
    });
    this.whom.replaceChildren(said("span", TEXTS.whom), ...choices);
  }

  // No daemon, or no contact with the panel: disable all orders until the next message.
  lose(reason) {
    [this.holdAll, ...(this.always ?? [])].forEach((button) => button && disable(button, reason));
    this.mainOrder.querySelectorAll("button").forEach((button) => disable(button, reason));
    this.shown = "";
  }

  // The reasons against an order and what to do, in place of its button.
  missing(order, targets, reason) {
    const list = this.listed(toDo(targets), "refuse", TEXTS.missing[order], "warning");
    const waits = targets.find(({ status }) => status.waiting_for)?.status.waiting_for;
    const words = waits ? TEXTS.waiting(waits) : reason;
    return list.length ? list : [said("h2", TEXTS.missing[order]), said("p", words)];
  }

  listed(rows, verdict, heading, level) {
    const kept = (rows ?? []).filter((row) => row.verdict === verdict);
    if (!kept.length) return [];
    const list = document.createElement("ul");
    for (const row of kept) {
      const line = document.createElement("li");
      line.className = level;
      line.append(said("b", `${TEXTS.shapes[level]} ${row.name}: ${row.found}`));
      const advice = [row.wanted && TEXTS.wanted(row.wanted), row.advice].filter(Boolean).join("; ");
      line.append(advice);
      list.append(line);
    }
    return [said("h2", TEXTS.counted(heading, kept.length)), list];
  }

  // A button of an order to the chosen vehicle or vehicles; `all` is always to the whole team.
  button(order, all = false) {
    const button = document.createElement("button");
    const [name, what, key] = all ? TEXTS.holdAll : TEXTS.orders[order];
    button.className = `order ${order} ${LOOKS[order] ?? ""} ${all ? "all" : ""}`;
    button.dataset.order = all ? `${order}-all` : order;
    const small = said("small", SLOW.has(order) ? TEXTS.holdDown : what);
    if (key) small.append(said("span", ` · ${key}`));
    button.append(document.createElement("i"), name, small);
    if (SLOW.has(order)) this.slow(button, order, name);
    else button.addEventListener("click", () => this.give(order, all || this.toAll));
    return button;
  }

  slow(button, order, name) {
    const press = new Press(button, () => {
      this.pressed = "";
      if (button.isConnected) this.give(order); // otherwise the state has changed meanwhile
    });
    const begin = (event) => {
      if (event.type === "keydown" && (event.repeat || !PRESSING.includes(event.key))) return;
      if (event.type === "pointerdown" && event.button !== 0) return;
      event.preventDefault();
      this.pressed = order;
      press.begin();
    };
    const end = () => {
      this.pressed = "";
      if (press.end()) this.say("unknown", TEXTS.tooShort(name));
    };
    for (const kind of ["pointerdown", "keydown"]) button.addEventListener(kind, begin);
    for (const kind of ["pointerup", "pointerleave", "pointercancel", "keyup", "blur"]) button.addEventListener(kind, end);
    button.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  // Keys outside text fields, pressed for as long as a slow button: speech input and typed text order nothing.
  listen() {
    let press = null;
    let held = "";
    const end = () => {
      if (press?.end()) this.say("unknown", TEXTS.tooShort(TEXTS.orders[KEYS[held]][0]));
      press = null;
    };
    document.addEventListener("keydown", (event) => {
      const key = event.key.toLowerCase();
      if (event.repeat && press && key === held) return;
      end(); // another key: this is text
      const order = KEYS[key];
      if (!order || event.repeat || isTyping() || event.ctrlKey || event.metaKey || event.altKey) return;
      held = key;
      press = new Press(this.always.find((button) => button.dataset.order === order), () => {
        press = null;
        this.give(order);
      });
      press.begin();
    });
    document.addEventListener("keyup", (event) => {
      if (event.key.toLowerCase() === held) end();
    });
    for (const [source, kind] of [[window, "blur"], [document, "visibilitychange"]]) source.addEventListener(kind, end);
  }

  async give(order, toAll = this.toAll) {
    const daemon = this.daemon;
    if (!daemon) {
      this.say("warning", TEXTS.noDaemon);
      return;
    }
    const name = `${toAll ? TEXTS.all(this.team.length) : daemon.name} · ${TEXTS.orders[order][0]}`;
    this.say("unknown", TEXTS.given(name));
    try {
      const answer = await fetch("order", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ daemon: daemon.key, order, by: document.querySelector("#by").value, team: toAll }),
      });
      const answers = await answer.json();
      const refused = answers.filter((one) => !one.accepted);
      const why = refused.map((one) => (toAll && one.name ? `${one.name}: ${one.reason}` : one.reason)).join("; ");
      const words = refused.length ? TEXTS.refused(name, why) : TEXTS.accepted(name);
      const rest = answers.length - refused.length;
      const some = refused.length && rest ? ` ${TEXTS.others(rest)}` : "";
      this.say(refused.length ? "warning" : "ok", words + some);
    } catch {
      this.say("warning", TEXTS.unanswered(name));
    }
  }

  say(level, words) {
    this.answer.className = level;
    this.answer.textContent = `${TEXTS.shapes[level]} ${words}`;
  }
}

// A press that counts after one second; its button shows the time.
class Press {
  constructor(button, done) {
    this.button = button;
    this.done = done;
    this.timer = null;
  }

  begin() {
    clearTimeout(this.timer);
    this.button.classList.add("held");
    this.timer = setTimeout(() => {
      this.end();
      this.done();
    }, HOLD_MS);
  }

  // Returns true if the press was too short.
  end() {
    this.button.classList.remove("held");
    const isShort = this.timer !== null;
    clearTimeout(this.timer);
    this.timer = null;
    return isShort;
  }
}

const isTyping = () => ["INPUT", "TEXTAREA", "SELECT"].includes(document.activeElement?.tagName);

// Reason against all orders; empty if the daemon is in contact.
function lost(daemon) {
  if (daemon.over) return TEXTS.isOver;
  return daemon.contact === "warning" ? TEXTS.noContact : "";
}

const stateOf = (daemon) => daemon.snapshot?.state ?? daemon.status.state ?? "connecting";

// Everything to do before an order, with the vehicle's name if there are several.
function toDo(targets) {
  const named = (one, row) => (targets.length > 1 ? { ...row, name: `${one.name}, ${row.name}` } : row);
  return targets.flatMap((one) => (one.status.to_do ?? []).map((row) => named(one, row)));
}

// Reason why an order would be refused; empty if it would be accepted: by one vehicle at least, or START and ENGAGE by all.
function against(targets, order) {
  const reasons = targets.map((one) => lost(one) || refusal(one, order));
  const at = TOGETHER.has(order) || reasons.every(Boolean) ? reasons.findIndex(Boolean) : -1;
  if (at < 0) return "";
  return targets.length > 1 ? `${targets[at].name}: ${reasons[at]}` : reasons[at];
}

// Reason why a daemon would refuse an order; empty if it would accept it, or if its status is of another state.
function refusal(daemon, order) {
  const { status } = daemon;
  if (status.refused_orders && status.state !== (daemon.snapshot?.state_words ?? stateOf(daemon))) return "";
  return status.refused_orders ? status.refused_orders[order] ?? "" : status.reason ?? status.waiting_for ?? "";
}

function disable(button, reason) {
  button.disabled = Boolean(reason);
  button.title = reason;
  const small = button.querySelector("small");
  small.dataset.words ??= small.innerHTML;
  if (reason) small.textContent = reason;
  else small.innerHTML = small.dataset.words;
}

function said(tag, words) {
  const element = document.createElement(tag);
  element.textContent = words;
  return element;
}
