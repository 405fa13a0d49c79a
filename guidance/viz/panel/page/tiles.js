// A map under the plan view: tiles of the panel's folder, or of the server of --tiles.
import { ink } from "./surface.js";
import { TEXTS } from "./texts.js";

const TILE_PX = 256;
const MOST_KEPT = 200;
const MOST_PARENTS = 5; // zoom levels above, where a tile is missing

export class Tiles {
  constructor(arrived) {
    this.arrived = arrived;
    this.source = document.documentElement.dataset.tiles ?? "";
    this.kept = new Map();
  }

  // Web Mercator tiles around home, placed in metres like the plan. Exact enough for a few kilometres.
  draw(plan, scene) {
    if (!this.source) return;
    const [latitude, longitude] = scene.home_deg;
    const cos = Math.cos((latitude * Math.PI) / 180);
    const world = 2 * Math.PI * 6378137 * cos;
    const zoom = Math.max(1, Math.min(19, Math.round(Math.log2((world * plan.scale) / TILE_PX))));
    const size = world / 2 ** zoom; // m
    const column = ((longitude + 180) / 360) * 2 ** zoom;
    const sin = Math.sin((latitude * Math.PI) / 180);
    const row = (0.5 - Math.log((1 + sin) / (1 - sin)) / (4 * Math.PI)) * 2 ** zoom;
    const [west, north] = plan.ground([0, 0]);
    const [east, south] = plan.ground([plan.surface.width, plan.surface.height]);
    const from = (x, y) => [Math.floor(column + (x - scene.home_m[0]) / size), Math.floor(row - (y - scene.home_m[1]) / size)];
    const [first, last] = [from(west, north), from(east, south)];
    let drawn = false;
    for (let x = first[0]; x <= last[0]; x++) {
      for (let y = first[1]; y <= last[1]; y++) {
        const place = plan.pixel([scene.home_m[0] + (x - column) * size, scene.home_m[1] - (y - row) * size]);
        drawn = this.tile(plan.surface.context, [zoom, x, y], place, size * plan.scale + 1) || drawn;
      }
    }
    if (!drawn) return;
    const { host } = new URL(this.source, location.href);
    const words = host === location.host ? TEXTS.map.local : TEXTS.map.by(host);
    plan.surface.text(words, 6, 12, ink("--faint"));
  }

  // A tile, or its part of a larger one if it is missing.
  tile(context, [zoom, x, y], [px, py], size) {
    for (let up = 0; up <= Math.min(zoom, MOST_PARENTS); up++) {
      const share = 2 ** up;
      const image = this.image(zoom - up, Math.floor(x / share), Math.floor(y / share));
      if (!image.complete) return false;
      if (!image.naturalWidth) continue;
      const part = image.naturalWidth / share;
      context.drawImage(image, (x % share) * part, (y % share) * part, part, part, px, py, size, size);
      return true;
    }
    return false;
  }

  image(zoom, x, y) {
    const url = this.source.replace("{z}", zoom).replace("{x}", x).replace("{y}", y);
    let image = this.kept.get(url);
    if (!image) {
      image = new Image();
      image.onload = image.onerror = this.arrived;
      image.src = url;
      this.kept.set(url, image);
      if (this.kept.size > MOST_KEPT) this.kept.delete(this.kept.keys().next().value);
    }
    return image;
  }
}
