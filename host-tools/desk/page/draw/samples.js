/**
 * The latest positions of both trunk points, in buffers of a fixed size: the oldest make room.
 *
 * Every position is in millimetres: AP forward, ML to the person's right, SI up. What was not
 * measured is NaN. Nothing here is smoothed or filled in.
 */

/** What is kept: a minute at 200 Hz. */
export const CAPACITY = 12_288;

/** @typedef {"lower" | "upper"} Point */
/** @type {Point[]} */
export const POINTS = ["lower", "upper"];

/** The axes, in the order in which a position lists them. */
export const AXES = ["AP", "ML", "SI"];

/**
 * A position and its covariance.
 *
 * @typedef {object} Seen
 * @property {number[]} mm AP, ML, SI.
 * @property {number[]} [covariance_mm2] Of AP and ML and SI with each other: AP AP, AP ML, AP SI, ML ML, ML SI, SI SI.
 */

/** Positions per axis, and entries of a covariance. */
const AXES_N = 3;
const COVARIANCE_N = 6;

export class Samples {
  constructor(capacity = CAPACITY) {
    this.capacity = capacity;
    this.time_s = new Float64Array(capacity);
    /** @type {Record<Point, Float32Array>} */
    this.mm = { lower: new Float32Array(capacity * AXES_N), upper: new Float32Array(capacity * AXES_N) };
    /** @type {Record<Point, Float32Array>} */
    this.covariance_mm2 = {
      lower: new Float32Array(capacity * COVARIANCE_N),
      upper: new Float32Array(capacity * COVARIANCE_N),
    };
    this.clear();
  }

  clear() {
    /** How many have ever come; the newest is number `count - 1`. */
    this.count = 0;
    /** Changes with each sample: a drawing that has seen it is up to date. */
    this.version = (this.version ?? 0) + 1;
  }

  /**
   * Adds the positions of a frame, which is later than those before.
   *
   * @param {number} time_s
   * @param {Partial<Record<Point, Seen | null>>} seen
   */
  push(time_s, seen) {
    const at = this.count % this.capacity;
    this.time_s[at] = time_s;
    for (const point of POINTS) {
      const { mm, covariance_mm2 } = seen[point] ?? {};
      for (let axis = 0; axis < AXES_N; axis += 1) this.mm[point][at * AXES_N + axis] = mm?.[axis] ?? NaN;
      for (let entry = 0; entry < COVARIANCE_N; entry += 1) {
        this.covariance_mm2[point][at * COVARIANCE_N + entry] = covariance_mm2?.[entry] ?? NaN;
      }
    }
    this.count += 1;
    this.version += 1;
  }

  /** The number of the oldest that is kept. */
  get oldest() {
    return Math.max(0, this.count - this.capacity);
  }

  /** The time of the newest, or NaN. @returns {number} */
  get newest_s() {
    return this.count ? this.time_s[(this.count - 1) % this.capacity] : NaN;
  }

  /** The number of the first that is not older than this. @param {number} from_s */
  since(from_s) {
    let [low, high] = [this.oldest, this.count];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time_s[middle % this.capacity] < from_s) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** @param {number} number */
  at_s(number) {
    return this.time_s[number % this.capacity];
  }

  /** One coordinate, mm. @param {Point} point @param {number} axis @param {number} number */
  value(point, axis, number) {
    return this.mm[point][(number % this.capacity) * AXES_N + axis];
  }

  /**
   * The variance of AP, the covariance of AP and ML, and the variance of ML, mm².
   *
   * @param {Point} point @param {number} number @returns {[number, number, number]}
   */
  transverse(point, number) {
    const from = (number % this.capacity) * COVARIANCE_N;
    const all = this.covariance_mm2[point];
    return [all[from], all[from + 1], all[from + 3]];
  }

  /** The standard deviation of one coordinate, mm. @param {Point} point @param {number} axis @param {number} number */
  sd(point, axis, number) {
    const diagonal = [0, 3, 5][axis];
    return Math.sqrt(this.covariance_mm2[point][(number % this.capacity) * COVARIANCE_N + diagonal]);
  }

  /**
   * The mean of each coordinate from a sample on, over what was measured: the middle of a drawing.
   *
   * @param {Point} point @param {number} from
   */
  middle(point, from) {
    const sums = [0, 0, 0];
    let count = 0;
    for (let number = from; number < this.count; number += 1) {
      const first = this.value(point, 0, number);
      if (Number.isNaN(first)) continue;
      count += 1;
      for (let axis = 0; axis < AXES_N; axis += 1) sums[axis] += this.value(point, axis, number);
    }
    return count ? sums.map((sum) => sum / count) : null;
  }
}
