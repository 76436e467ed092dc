/**
 * The desk's clock on this page: milliseconds since the desk was started.
 *
 * A ping tells by how much the page's clock is apart, to half the time that the answer took. The
 * quickest of the latest answers counts; older ones are forgotten, because clocks drift.
 */

/** How many answers are compared. */
const KEPT = 8;

/** A desk whose clock is further from this one is not the same. */
const SAME_MS = 5_000;

export class Clock {
  constructor() {
    /** @type {{took_ms: number, apart_ms: number}[]} */
    this.answers = [];
    this.apart_ms = NaN;
  }

  /** @param {number} sent_ms The page's clock at the ping. @param {number} desk_ms The answer's. */
  pong(sent_ms, desk_ms) {
    const now_ms = performance.now();
    this.answers.push({ took_ms: now_ms - sent_ms, apart_ms: desk_ms - (sent_ms + now_ms) / 2 });
    if (this.answers.length > KEPT) this.answers.shift();
    this.apart_ms = this.answers.reduce((best, it) => (it.took_ms < best.took_ms ? it : best)).apart_ms;
  }

  /** Whether a desk that says this is another one than before, or the page was asleep. @param {number} desk_ms */
  is_of_another(desk_ms) {
    return Math.abs(desk_ms - this.now_ms()) > SAME_MS;
  }

  /** After a break the network may be another one. */
  forget() {
    this.answers = [];
  }

  /** Something that the desk dated has arrived: good enough until the first pong. @param {number} desk_ms */
  at_least(desk_ms) {
    if (Number.isNaN(this.apart_ms)) this.apart_ms = desk_ms - performance.now();
  }

  /** What it is now, or was at a time of the page's own clock. @param {number} [page_ms] */
  now_ms(page_ms = performance.now()) {
    return page_ms + this.apart_ms;
  }
}
