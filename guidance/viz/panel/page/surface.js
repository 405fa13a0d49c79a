// A canvas with the page's pixels and colours, and the shapes that all drawings use.
export class Surface {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.width = this.height = 0;
  }

  // Clear it and set its size; false if it is hidden.
  begin() {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (!width || !height) return false;
    const size = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) [this.canvas.width, this.canvas.height] = size;
    [this.width, this.height] = [width, height];
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.context.clearRect(0, 0, width, height);
    this.context.lineJoin = "round";
    this.context.textBaseline = "middle";
    this.font(12);
    return true;
  }

  font(size, weight = 400) {
    this.context.font = `${weight} ${size}px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif`;
  }

  // A line through points in pixels; null breaks it.
  line(points, colour, width = 1, dash = []) {
    const { context } = this;
    context.beginPath();
    let open = false;
    for (const point of points) {
      if (point === null) {
        open = false;
      } else if (open) {
        context.lineTo(point[0], point[1]);
      } else {
        context.moveTo(point[0], point[1]);
        open = true;
      }
    }
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.setLineDash(dash);
    context.stroke();
    context.setLineDash([]);
  }

  fill(points, colour, opacity = 1) {
    const { context } = this;
    context.beginPath();
    points.forEach(([x, y], at) => (at ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.closePath();
    context.globalAlpha = opacity;
    context.fillStyle = colour;
    context.fill();
    context.globalAlpha = 1;
  }

  // Fill what several closed curves have in common.
  fillCommon(curves, colour, opacity) {
    const { context } = this;
    context.save();
    for (const points of curves.slice(1)) {
      context.beginPath();
      points.forEach(([x, y], at) => (at ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.clip();
    }
    this.fill(curves[0], colour, opacity);
    context.restore();
  }

  dot([x, y], radius, colour) {
    this.context.beginPath();
    this.context.arc(x, y, radius, 0, 2 * Math.PI);
    this.context.fillStyle = colour;
    this.context.fill();
  }

  star([x, y], radius, colour) {
    const points = [...Array(10).keys()].map((at) => {
      const [turn, far] = [(at * Math.PI) / 5 - Math.PI / 2, at % 2 ? 0.45 * radius : radius];
      return [x + far * Math.cos(turn), y + far * Math.sin(turn)];
    });
    this.fill(points, colour);
    this.line([...points, points[0]], ink("--ink"), 1);
  }

  text(words, x, y, colour, align = "left") {
    const { context } = this;
    context.textAlign = align;
    context.strokeStyle = ink("--card");
    context.lineWidth = 3;
    context.strokeText(words, x, y);
    context.fillStyle = colour;
    context.fillText(words, x, y);
  }
}

let inks = null;

// A colour of the style sheet, kept until the theme changes.
export function ink(name) {
  inks ??= getComputedStyle(document.documentElement);
  return (kept[name] ??= inks.getPropertyValue(name).trim());
}

const kept = {};

export function forgetInks() {
  inks = null;
  for (const name of Object.keys(kept)) delete kept[name];
}

// A round step (1, 2 or 5 times a power of ten) that divides a length into at most `most` parts.
export function roundStep(length, most) {
  const raw = length / most;
  const power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((one) => one * power >= raw);
}

// Format a number without "-0.0".
export function fixed(value, digits) {
  const words = value.toFixed(digits);
  return Number(words) === 0 ? words.replace("-", "") : words;
}

// Columns of the history with their places.
export const [PURSUER, EVADER] = [1, 2];
