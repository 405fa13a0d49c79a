// Orders. The daemon accepts or refuses them, and the page shows its answer. START, ENGAGE and ABORT need a press of 1 s.
import { TEXTS } from "./texts.js";

const HOLD_MS = 1000;
const LOOKS = { start: "go", engage: "go", hold: "stop", land: "stop", abort: "last" };
const SLOW = new Set(["start", "engage", "abort"]);
const KEYS = { h: "hold", l: "land" };
const ALWAYS = ["hold", "land", "return", "abort"];

// The next order in each state. The daemon's `refused_orders` gives the reason if it would refuse it.
const NEXT = {
  connecting: "start", checking: "start", ready: "start", waiting: "start", "standing by": "engage", holding: "engage",
  landed: "reset", yielded: "reset", failed: "reset",
};

export class Orders {
  constructor(element, lookOnly) {
    this.next = element.querySelector("#next");
    this.answer = element.querySelector("#answer");
    this.lookOnly = lookOnly;
    this.daemon = null;
    this.shown = "";
    this.pressed = ""; // the order whose button is pressed; the button is not replaced meanwhile
    if (lookOnly) return;
    this.always = ALWAYS.map((order) => this.button(order));
    element.querySelector("#buttons").append(...this.always);
    document.addEventListener("keydown", (event) => this.key(event));
  }

  show(daemon) {
    this.daemon = daemon;
    const state = daemon.snapshot?.state ?? daemon.status.state ?? "connecting";
    const status = daemon.status;
    const gone = lost(daemon);
    const words = daemon.snapshot?.state_words ?? state;
    this.always?.forEach((button) => disable(button, gone || refusal(daemon, words, button.dataset.order)));
    const order = gone ? undefined : NEXT[state];
    const reason = status.refused_orders?.[order] ?? status.reason ?? "";
    const after = TEXTS.after[status.after_capture] ?? TEXTS.after.hold;
    const about = gone || (TEXTS.about[state]?.(after) ?? "");
    const what = JSON.stringify([daemon.key, state, order, reason, status.to_do, status.waiting_for, about]);
    if (what === this.shown) return;
    const blocked = order !== "reset" && (reason || !status.refused_orders);
    if (this.pressed && this.pressed === order && !blocked) return;
    this.shown = what;
    const parts = [];
    if (order && !blocked && this.lookOnly) parts.push(said("p", TEXTS.awaits(TEXTS.orders[order][0])));
    else if (order && !blocked) parts.push(this.button(order), said("p", TEXTS.ready[order] ?? ""));
    else if (order) parts.push(...this.missing(order, status, reason));
    else parts.push(said("p", about));
    if (order === "start") parts.push(...this.listed(status.to_do, "warn", TEXTS.advised, "caution"));
    this.next.replaceChildren(...parts);
  }

  // No contact with the panel: disable all orders until the next message.
  lose(reason) {
    this.always?.forEach((button) => disable(button, reason));
    this.next.querySelectorAll("button").forEach((button) => disable(button, reason));
    this.shown = "";
  }

  // The reasons against an order and what to do, in place of its button.
  missing(order, status, reason) {
    const list = this.listed(status.to_do, "refuse", TEXTS.missing[order], "warning");
    const words = status.waiting_for ? TEXTS.waiting(status.waiting_for) : reason;
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

  button(order) {
    const button = document.createElement("button");
    const [name, what, key] = TEXTS.orders[order];
    button.className = `order ${order} ${LOOKS[order] ?? ""}`;
    button.dataset.order = order;
    const small = said("small", SLOW.has(order) ? TEXTS.holdDown : what);
    if (key) small.append(said("span", ` · ${key}`));
    button.append(document.createElement("i"), name, small);
    if (SLOW.has(order)) this.slow(button, order, name);
    else button.addEventListener("click", () => this.give(order));
    return button;
  }

  slow(button, order, name) {
    let timer = null;
    const begin = (event) => {
      if (event.type === "keydown" && (event.repeat || ![" ", "Enter"].includes(event.key))) return;
      if (event.type === "pointerdown" && event.button !== 0) return;
      event.preventDefault();
      button.classList.add("held");
      this.pressed = order;
      clearTimeout(timer);
      timer = setTimeout(() => {
        timer = null;
        this.pressed = "";
        button.classList.remove("held");
        if (button.isConnected) this.give(order); // otherwise the state has changed meanwhile
      }, HOLD_MS);
    };
    const end = () => {
      button.classList.remove("held");
      this.pressed = "";
      if (timer === null) return;
      clearTimeout(timer);
      timer = null;
      this.say("unknown", TEXTS.tooShort(name));
    };
    for (const kind of ["pointerdown", "keydown"]) button.addEventListener(kind, begin);
    for (const kind of ["pointerup", "pointerleave", "pointercancel", "keyup", "blur"]) button.addEventListener(kind, end);
    button.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  key(event) {
    const typing = ["INPUT", "TEXTAREA", "SELECT"].includes(document.activeElement?.tagName);
    if (typing || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
    const order = KEYS[event.key.toLowerCase()];
    if (order) this.give(order);
  }

  async give(order) {
    const daemon = this.daemon;
    if (!daemon) {
      this.say("warning", TEXTS.noDaemon);
      return;
    }
    const name = `${daemon.name} · ${TEXTS.orders[order][0]}`;
    this.say("unknown", TEXTS.given(name));
    try {
      const answer = await fetch("order", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ daemon: daemon.key, order, by: document.querySelector("#by").value }),
      });
      const { accepted, reason } = await answer.json();
      this.say(accepted ? "ok" : "warning", accepted ? TEXTS.accepted(name) : TEXTS.refused(name, reason));
    } catch {
      this.say("warning", TEXTS.unanswered(name));
    }
  }

  say(level, words) {
    this.answer.className = level;
    this.answer.textContent = `${TEXTS.shapes[level]} ${words}`;
  }
}

// Reason against all orders; empty if the daemon is in contact.
function lost(daemon) {
  if (daemon.over) return TEXTS.isOver;
  return daemon.contact === "warning" ? TEXTS.noContact : "";
}

// Reason why the daemon would refuse an order; empty if it would accept it, or if its status is of another state.
function refusal(daemon, state, order) {
  const { status } = daemon;
  if (status.refused_orders && status.state !== state) return "";
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
