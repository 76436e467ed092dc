/**
 * The connection to the desk: signs in, holds the WebSocket, and opens it again after a break, sooner
 * at first and later more seldom. What the desk says is handed on; nothing is kept here but the
 * latest state.
 */

import { Clock } from "./clock.js";
import { get, post } from "./requests.js";

/** @typedef {import("./wire.js").State} State */
/** @typedef {{version: string, signed_in: boolean, sign_in: "token" | "password"}} Greeting */

/** `lost_ms` is the page's clock. @typedef {{is: "connecting"} | {is: "open"} | {is: "lost", lost_ms: number, again_ms: number} | {is: "sign_in", greeting: Greeting}} Status */

const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 5_000;
/** The desk drops pages that are silent for 30 s. */
const PING_MS = 4_000;
/** A desk that says nothing for so long is lost, although the connection stands. */
const SILENT_MS = 15_000;

export class Connection {
  /**
   * @param {{status: (status: Status) => void, state: (state: State) => void, frames: (message: any) => void, tone: (message: any) => void, another: () => void}} told
   *   Whom to tell what.
   */
  constructor(told) {
    this.told = told;
    this.clock = new Clock();
    /** @type {WebSocket | null} */
    this.socket = null;
    this.wait_ms = FIRST_WAIT_MS;
    this.timer = 0;
    this.heard_ms = 0;
    /** @type {{box: string, after: () => number | null} | null} */
    this.watched = null;
    setInterval(() => this.#look_after(), PING_MS);
    addEventListener("online", () => this.now());
    document.addEventListener("visibilitychange", () => document.hidden || this.now());
  }

  /** Connects, if this page is signed in. */
  async open() {
    clearTimeout(this.timer);
    this.timer = 0;
    let greeting;
    try {
      greeting = /** @type {Greeting} */ (await get("/api/hello"));
    } catch {
      return this.#again();
    }
    if (!greeting.signed_in) return this.told.status({ is: "sign_in", greeting });
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
    this.socket = socket;
    socket.onopen = () => {
      this.wait_ms = FIRST_WAIT_MS;
      this.heard_ms = performance.now();
      this.clock.forget();
      this.#ping();
      this.#watch();
      this.told.status({ is: "open" });
    };
    socket.onmessage = (event) => this.#hear(JSON.parse(event.data));
    socket.onclose = () => {
      if (this.socket !== socket) return;
      this.socket = null;
      this.#again();
    };
  }

  /** Tries at once, if it waits. */
  now() {
    if (this.timer) void this.open();
  }

  /** @param {string} password */
  async sign_in(password) {
    await post("/api/login", { password });
    this.told.status({ is: "connecting" });
    await this.open();
  }

  /**
   * Asks for the frames of a box.
   *
   * @param {string | null} box
   * @param {() => number | null} after The number of the latest frame that is drawn.
   */
  watch(box, after) {
    this.watched = box === null ? null : { box, after };
    this.#watch();
  }

  /** A batch has come. @param {number} batch @param {number | null} screen_ms */
  acknowledge(batch, screen_ms) {
    this.#say({ is: "ack", batch, screen_ms });
  }

  #watch() {
    this.#say({ is: "watch", box: this.watched?.box ?? null, after: this.watched?.after() ?? null });
  }

  #ping() {
    this.#say({ is: "ping", page_ms: performance.now() });
  }

  /** @param {object} message */
  #say(message) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  /** @param {any} message */
  #hear(message) {
    this.heard_ms = performance.now();
    switch (message.is) {
      case "state":
        if (this.clock.is_of_another(message.state.now_ms)) this.#another_desk();
        this.clock.at_least(message.state.now_ms);
        this.told.state(message.state);
        break;
      case "frames":
        this.told.frames(message);
        break;
      case "tone":
        this.told.tone(message);
        break;
      case "pong":
        this.clock.pong(message.page_ms, message.desk_ms);
        break;
      case "refused":
        console.error("The desk does not understand this page", message.problem);
        break;
    }
  }

  /** The desk was started anew: its clock and its numbers of frames have begun again. */
  #another_desk() {
    this.clock = new Clock();
    this.#ping();
    this.told.another();
    this.#watch();
  }

  #look_after() {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    if (performance.now() - this.heard_ms < SILENT_MS) return this.#ping();
    // Its own end may take minutes to be noticed.
    const dead = this.socket;
    this.socket = null;
    dead.close();
    this.#again();
  }

  #again() {
    if (this.timer) return;
    const wait_ms = this.wait_ms;
    this.wait_ms = Math.min(2 * wait_ms, LONGEST_WAIT_MS);
    const now_ms = performance.now();
    this.told.status({ is: "lost", lost_ms: now_ms, again_ms: now_ms + wait_ms });
    this.timer = setTimeout(() => void this.open(), wait_ms);
  }
}
