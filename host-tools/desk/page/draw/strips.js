/**
 * AP, ML and SI of both trunk points over the last seconds, below each other, each about the mean
 * of what is shown, with the interval in which it lies at 95 % as a shade. Where a point was not
 * measured, its lines have a gap and the strip is grey.
 */

import { font } from "./canvas.js";
import { Reach } from "./scale.js";
import { AXES, POINTS } from "./samples.js";

/** How much is shown. */
export const SPAN_S = 20;

/** Two frames further apart than this many times the usual distance have a gap between them. */
const GAP_FRAMES = 2.5;

const SD = 1.96;
const LEFT_PX = 64;
const BOTTOM_PX = 22;
const REACH_MM_MIN = 1;

/** @typedef {import("./samples.js").Samples} Samples */

/** @param {Samples} samples */
export function strips(samples) {
  const reaches = AXES.map(() => new Reach(REACH_MM_MIN));
  /** @type {(context: CanvasRenderingContext2D, width: number, height: number, colours: Record<string, string>) => void} */
  return (context, width, height, colours) => {
    const newest_s = samples.newest_s;
    const from = samples.since(newest_s - SPAN_S);
    const right = width - 8;
    const x = (/** @type {number} */ time_s) => right - ((newest_s - time_s) / SPAN_S) * (right - LEFT_PX);
    const strip_px = (height - BOTTOM_PX) / AXES.length;
    const gaps = find_gaps(samples, from, newest_s - SPAN_S);
    const middles = Object.fromEntries(POINTS.map((point) => [point, samples.middle(point, from)]));
    AXES.forEach((name, axis) => {
      const top = axis * strip_px;
      const half_mm = reaches[axis].fit(furthest(samples, from, middles, axis));
      const y = (/** @type {number} */ mm) => top + strip_px / 2 - (mm / half_mm) * (strip_px / 2 - 6);
      context.fillStyle = colours.gap;
      context.globalAlpha = 0.5;
      for (const [start_s, end_s] of gaps) {
        context.fillRect(x(start_s), top + 3, Math.max(1.5, x(end_s) - x(start_s)), strip_px - 6);
      }
      context.globalAlpha = 1;
      frame(context, name, half_mm, y, right, top, strip_px, colours);
      for (const point of POINTS) {
        if (middles[point]) line(context, samples, point, axis, from, middles[point][axis], x, y, colours[point]);
      }
    });
    times(context, x, right, height, colours);
  };
}

/** The times, seconds, in which a point or a whole frame is missing. */
function find_gaps(samples, from, start_s) {
  const gaps = [];
  if (samples.count - from < 2) return gaps;
  const usual_s = (samples.newest_s - samples.at_s(from)) / (samples.count - 1 - from);
  let before_s = Math.max(start_s, samples.at_s(from));
  for (let number = from; number < samples.count; number += 1) {
    const now_s = samples.at_s(number);
    const is_missing = POINTS.some((point) => Number.isNaN(samples.value(point, 0, number)));
    if (is_missing || now_s - before_s > GAP_FRAMES * usual_s) {
      const last = gaps.at(-1);
      if (last && last[1] === before_s) last[1] = now_s;
      else gaps.push([before_s, now_s]);
    }
    before_s = now_s;
  }
  return gaps;
}

function furthest(samples, from, middles, axis) {
  let most = 0;
  for (const point of POINTS) {
    if (!middles[point]) continue;
    for (let number = from; number < samples.count; number += 1) {
      const away = Math.abs(samples.value(point, axis, number) - middles[point][axis]);
      if (away > most) most = away;
    }
  }
  return most;
}

function frame(context, name, half_mm, y, right, top, strip_px, colours) {
  context.strokeStyle = colours.line;
  context.lineWidth = 1;
  context.beginPath();
  for (const mm of [-half_mm, 0, half_mm]) {
    context.moveTo(LEFT_PX, Math.round(y(mm)) + 0.5);
    context.lineTo(right, Math.round(y(mm)) + 0.5);
  }
  context.stroke();
  context.fillStyle = colours.ink;
  context.textAlign = "left";
  context.textBaseline = "middle";
  context.font = `650 ${font(15)}`;
  context.fillText(name, 2, top + strip_px / 2);
  context.font = font(11);
  context.fillStyle = colours.soft;
  context.textAlign = "right";
  context.fillText(`+${half_mm}`, LEFT_PX - 6, y(half_mm) + 4);
  context.fillText(`−${half_mm}`, LEFT_PX - 6, y(-half_mm) - 4);
}

function line(context, samples, point, axis, from, middle, x, y, colour) {
  context.fillStyle = colour;
  context.strokeStyle = colour;
  context.lineWidth = 1.6;
  context.lineJoin = "round";
  const usual_s = (samples.newest_s - samples.at_s(from)) / Math.max(1, samples.count - 1 - from);
  const ends = (/** @type {number} */ number) =>
    number >= samples.count ||
    Number.isNaN(samples.value(point, axis, number)) ||
    (number > from && samples.at_s(number) - samples.at_s(number - 1) > GAP_FRAMES * usual_s);
  for (let first = from; first < samples.count; ) {
    if (Number.isNaN(samples.value(point, axis, first))) {
      first += 1;
      continue;
    }
    let end = first + 1;
    while (!ends(end)) end += 1;
    shade(context, samples, point, axis, first, end, middle, x, y);
    context.beginPath();
    for (let number = first; number < end; number += 1) {
      context.lineTo(x(samples.at_s(number)), y(samples.value(point, axis, number) - middle));
    }
    context.stroke();
    first = end;
  }
}

/** The interval at 95 % along a piece of a line. */
function shade(context, samples, point, axis, first, end, middle, x, y) {
  const at = (/** @type {number} */ number, /** @type {number} */ sign) => {
    const sd_mm = samples.sd(point, axis, number) || 0;
    return y(samples.value(point, axis, number) - middle + sign * SD * sd_mm);
  };
  context.globalAlpha = 0.22;
  context.beginPath();
  for (let number = first; number < end; number += 1) context.lineTo(x(samples.at_s(number)), at(number, 1));
  for (let number = end - 1; number >= first; number -= 1) context.lineTo(x(samples.at_s(number)), at(number, -1));
  context.fill();
  context.globalAlpha = 1;
}

function times(context, x, right, height, colours) {
  context.fillStyle = colours.soft;
  context.font = font(12);
  context.textBaseline = "bottom";
  for (let ago_s = 0; ago_s <= SPAN_S; ago_s += 5) {
    context.textAlign = ago_s === 0 ? "right" : "center";
    const at = right - (ago_s / SPAN_S) * (right - LEFT_PX);
    context.fillText(ago_s === 0 ? "now" : `−${ago_s} s`, at, height - 2);
  }
}
