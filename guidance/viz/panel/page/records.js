// The list of records: outcome, report, events, exports and replay of each.
import { TEXTS } from "./texts.js";

const AGAIN_MS = 500;

export class Records {
  constructor(dialog, button) {
    this.dialog = dialog;
    this.shown = "";
    button.addEventListener("click", () => this.open());
  }

  async open() {
    this.fill([element("p", TEXTS.reading)]);
    this.dialog.showModal();
    this.shown = "";
    while (this.dialog.open && (await this.load())) await new Promise((then) => setTimeout(then, AGAIN_MS));
  }

  // Shows the list. Returns true while the panel still reads details.
  async load() {
    try {
      const answer = await fetch("records");
      const text = await answer.text();
      if (!answer.ok) throw new Error(text);
      const said = JSON.parse(text);
      if (text !== this.shown) this.fill(this.table(said));
      this.shown = text;
      return said.records.some((row) => row.reading);
    } catch (error) {
      this.fill([element("p", String(error))]);
      return false;
    }
  }

  fill(parts) {
    const close = element("button", TEXTS.close);
    close.addEventListener("click", () => this.dialog.close());
    const head = element("h2", TEXTS.records);
    const gap = element("span", "");
    gap.className = "gap";
    head.append(gap, close);
    this.dialog.replaceChildren(head, ...parts);
  }

  table({ folder, exports: kinds, records }) {
    if (!records.length) return [element("p", TEXTS.noRecords(folder))];
    const table = document.createElement("table");
    const head = document.createElement("tr");
    head.append(...TEXTS.columns.map((words) => element("th", words)));
    table.append(head, ...records.map((row) => this.row(row, kinds)));
    const parts = [element("p", TEXTS.recordsIn(folder)), table];
    const read = records.filter((row) => !row.reading).length;
    if (read === records.length) return parts;
    const bar = document.createElement("progress");
    [bar.max, bar.value] = [records.length, read];
    const progress = element("p", `${TEXTS.progress(read, records.length)} `);
    progress.append(bar);
    return [progress, ...parts];
  }

  row(row, kinds) {
    const line = document.createElement("tr");
    const name = element("td", row.record.replace(/\/record\.mcap$/, ""));
    name.title = row.title ?? "";
    const begun = (row.started_utc ?? "").replace("T", " ").slice(0, 19);
    const lasts = row.duration_s === undefined ? "" : `${row.duration_s.toFixed(0)} s`;
    const again = document.createElement("td");
    const out = document.createElement("td");
    if (!row.error) {
      again.append(
        link(TEXTS.replayed, "replay", row.record), link(TEXTS.report, "records/report", row.record),
        link(TEXTS.eventList, "records/events", row.record),
      );
      out.append(...kinds.map((kind) => link(kind, `records/${kind}`, row.record)));
    }
    line.append(name, element("td", begun), element("td", lasts), element("td", outcome(row)), again, out);
    return line;
  }
}

function outcome(row) {
  if (row.reading) return TEXTS.reading;
  if (row.error) return row.error;
  const words = [row.captured ? TEXTS.captured : TEXTS.notCaptured, row.ended && TEXTS.ended(row.ended)];
  if (row.alarms) words.push(TEXTS.alarms(row.alarms));
  return [words.filter(Boolean).join(", "), row.torn && TEXTS.torn].filter(Boolean).join(" ");
}

export function link(words, path, record) {
  const made = element("a", words);
  made.href = `${path}?record=${encodeURIComponent(record)}`;
  made.target = "_blank";
  made.rel = "noopener";
  return made;
}

function element(tag, words) {
  const made = document.createElement(tag);
  made.textContent = words;
  return made;
}
