// Receives the panel's messages and stores them by daemon. The WebSocket reconnects by itself.
export const WINDOW_S = 300;
const AGAIN_MS = 1000;
const SILENT_MS = 2000;
const MOST_EVENTS = 200;

// Asks the panel what this page may do, and whether it is at the panel's own address.
export const askPanel = () => fetch(`alive?origin=${encodeURIComponent(location.origin)}`);

export class Feed {
  // changed(): new data; lost(reason): "gone" if the panel does not answer, "closed" if it refuses the cookie, "refused"
  // or "full" if it answers but opens no WebSocket: behind a proxy that changes the address, or for too many pages.
  constructor(changed, lost) {
    this.changed = changed;
    this.lost = lost;
    this.daemons = new Map();
    this.buses = [];
    this.leftOut = 0;
    this.heardMs = -Infinity;
    this.connect();
    setInterval(() => this.watch(), 500);
  }

  connect() {
    const socket = new WebSocket(new URL("live", location.href.replace(/^http/, "ws")));
    this.socket = socket;
    let opened = false;
    socket.onopen = () => {
      opened = true;
    };
    socket.onmessage = (event) => this.take(JSON.parse(event.data));
    socket.onclose = () => {
      setTimeout(() => this.again(opened), AGAIN_MS);
    };
  }

  async again(opened) {
    try {
      const answer = await askPanel();
      if (answer.status === 403) {
        this.lost("closed");
        return;
      }
      if (!opened && answer.ok) this.lost((await answer.json()).here ? "full" : "refused");
      this.connect();
    } catch {
      this.lost("gone");
      setTimeout(() => this.again(opened), AGAIN_MS);
    }
  }

  say(words) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(words);
  }

  watch() {
    if (performance.now() - this.heardMs > SILENT_MS && this.heardMs > 0) this.lost("gone");
  }

  take(message) {
    this.heardMs = performance.now();
    this.buses = message.buses;
    this.leftOut = message.left_out;
    if (message.whole) this.daemons.clear();
    for (const said of message.daemons) this.daemons.set(said.key, merged(this.daemons.get(said.key), said));
    this.changed();
  }
}

// Merge one message into the stored data of a daemon.
export function merged(known, said) {
  const daemon = known ?? { events: [], rows: [], status: {}, columns: [] };
  const { events, history, snapshot, ...plain } = said;
  Object.assign(daemon, plain);
  if (history) {
    daemon.columns = history.columns;
    daemon.rows = history.rows;
  }
  if (events) daemon.events = [...(history ? [] : daemon.events), ...events].slice(-MOST_EVENTS);
  if (snapshot !== undefined) daemon.snapshot = snapshot; // null: none that can be read yet
  if (snapshot && !history) remember(daemon, snapshot);
  return daemon;
}

// Append a row for charts and tracks: four a second, for five minutes.
function remember(daemon, seen) {
  const last = daemon.rows.at(-1);
  if (last && seen.now_s < last[0]) daemon.rows = [];
  if (last && seen.now_s - last[0] < 0.25 && seen.now_s >= last[0]) return;
  daemon.rows.push(rowOf(seen, daemon.columns));
  while (daemon.rows.length && seen.now_s - daemon.rows[0][0] > WINDOW_S) daemon.rows.shift();
}

// A row of the charts: each column is the path of its value in a snapshot.
export function rowOf(seen, columns) {
  return columns.map((path) => path.split(".").reduce((part, step) => part?.[step] ?? null, seen));
}
