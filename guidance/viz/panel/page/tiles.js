// A map under the plan view, from the tile server of --tiles.
import { ink } from "./surface.js";
import { TEXTS } from "./texts.js";

const TILE_PX = 256;
const MOST_KEPT = 200;

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
    for (let x = first[0]; x <= last[0]; x++) {
      for (let y = first[1]; y <= last[1]; y++) {
        const image = this.image(zoom, x, y);
        if (!image.complete || !image.naturalWidth) continue;
        const [px, py] = plan.pixel([scene.home_m[0] + (x - column) * size, scene.home_m[1] - (y - row) * size]);
        plan.surface.context.drawImage(image, px, py, size * plan.scale + 1, size * plan.scale + 1);
      }
    }
    const { width, height } = plan.surface;
    plan.surface.text(TEXTS.map.by(new URL(this.source).host), width - 6, height - 12, ink("--faint"), "right");
  }

  image(zoom, x, y) {
    const url = this.source.replace("{z}", zoom).replace("{x}", x).replace("{y}", y);
    let image = this.kept.get(url);
    if (!image) {
      image = new Image();
      image.onload = this.arrived;
      image.src = url;
      this.kept.set(url, image);
      if (this.kept.size > MOST_KEPT) this.kept.delete(this.kept.keys().next().value);
    }
    return image;
  }
}
