/** The frames of the box that is watched: kept for the drawings, acknowledged, and timed to the screen. */

import { drawings } from "./canvas.js";
import { Samples } from "./samples.js";

/** @typedef {import("../desk/connection.js").Connection} Connection */

export class LiveFrames {
  constructor() {
    this.samples = new Samples();
    /** @type {string | null} */
    this.box = null;
    /** Frames that the desk dropped for this page, because it was slow. */
    this.dropped = 0;
    /** From exposure to pixels of the latest that was timed and not told, ms. @type {number | null} */
    this.screen_ms = null;
    this.is_timing = false;
  }

  /** @param {Connection} connection @param {string | null} box */
  watch(connection, box) {
    if (box === this.box) return;
    this.box = box;
    this.dropped = 0;
    this.samples.clear();
    connection.watch(box, () => this.samples.latest);
  }

  /** @param {Connection} connection @param {any} message */
  frames(connection, message) {
    connection.acknowledge(message.batch, this.screen_ms);
    this.screen_ms = null;
    if (message.box !== this.box) return;
    this.dropped += message.dropped;
    this.samples.add(message.frames, message.reference);
    this.#time(connection);
  }

  /** What is drawn in the next picture of the display is on the screen when the one after it begins. */
  #time(connection) {
    if (this.is_timing || document.hidden || drawings() === 0) return;
    this.is_timing = true;
    requestAnimationFrame(() => {
      const exposed_ms = this.samples.newest_ms;
      requestAnimationFrame((begun_ms) => {
        this.is_timing = false;
        this.screen_ms = connection.clock.now_ms(begun_ms) - exposed_ms;
      });
    });
  }
}
