// A Haply Inverse3 by its service's WebSocket. This worker owns the socket and computes no force: it judges, by its own clock, whether the law's worker and
// the page still run, as a debugger stops one thread at a time. device.js starts it. The service speaks first (an inventory), then answers each message
// with one state. One message is under way at a time.
const LIMIT_N = 5, FRESH_MS = 12, PAGE_MS = 12, LOOK_MS = 2, GONE_MS = 1000, PACE_MS = 1, RAMP_MS = 100; // browsers look every 4 ms at most

const vector = (x) => (x && [x.x, x.y, x.z].every(Number.isFinite) ? [x.x, x.y, x.z] : null);

// The newest sign of life of another thread (the law's with its force), and its age. Clocks of threads differ by a constant: the quickest message so far shows it.
class Newest {
  constructor() { Object.assign(this, { N: [0, 0, 0], at_ms: -Infinity, offset_ms: Infinity }); }
  take({ N, at_ms }) {
    this.offset_ms = Math.min(this.offset_ms, performance.now() - at_ms);
    Object.assign(this, { N, at_ms });
  }
  get age_ms() { return performance.now() - this.at_ms - this.offset_ms; }
}

class Haply {
  // tick(cursor_m, buttons, gain): called with every state. force, page: a Newest. tell(text): for the page.
  constructor(url, { tick, force, page, tell }) {
    Object.assign(this, { tick, force, page, tell, trips: 0, known: null, first: true, under: 0, sent: 0, refused: 0, withheld_ms: null, enabled: true, gain: 0, sent_ms: 0, why: '', last_ms: performance.now() });
    this.socket = new WebSocket(url);
    this.socket.onopen = () => tell('connected; waiting for the inventory');
    this.socket.onmessage = ({ data }) => this.receive(data);
    this.socket.onclose = () => {
      this.known = null;
      clearInterval(this.watch);
      if (!this.closed) tell('the service closed the connection, or none runs there; start the Haply Inverse Service', true);
    };
    this.watch = setInterval(() => this.look(), LOOK_MS);
  }

  receive(text) {
    let message;
    try { message = JSON.parse(text); } catch { this.refused++; this.answered(); return; }
    if (!this.known) this.inventory(message);
    else if (this.under > 0) { this.state(message); this.answered(); } // an answer to nothing is of unknown age
  }

  inventory(message) {
    const item = message?.inverse3?.[0];
    if (!item || !/^[\w-]{1,60}$/.test(item.device_id ?? '')) return this.tell('the service has no Inverse3; plug it in');
    this.since35 = Boolean(message.session_id ?? message.session ?? item.config?.filters ?? item.config?.basis);
    this.known = item.device_id;
    this.tell(`Inverse3 ${this.known}`);
    return this.send();
  }

  state(message) {
    const item = message?.inverse3?.find?.((d) => d?.device_id === this.known), cursor = vector(item?.state?.cursor_position);
    if (!cursor || cursor.some((x) => Math.abs(x) > 1)) { this.refused++; return; }
    if (item.status?.power_supply === false) this.tell('the device has no power supply; plug it in');
    const grip = (message.wireless_verse_grip ?? message.custom_verse_grip ?? message.verse_grip)?.[0]?.state, buttons = grip?.buttons ?? {};
    this.tick(cursor, { a: Boolean(buttons.a ?? grip?.button), b: Boolean(buttons.b) }, this.gain);
  }

  answered() {
    this.under = Math.max(0, this.under - 1);
    this.last_ms = performance.now();
    setTimeout(() => { if (!this.under) this.send(); }, PACE_MS);
  }

  // Why no force may go out now; empty: it may.
  held() {
    if (!this.enabled) return 'the tab is hidden';
    if (!(this.force.age_ms < FRESH_MS)) return "the law's worker does not run";
    if (!(this.page.age_ms < PAGE_MS)) return 'the page does not run';
    return Number.isFinite(Math.hypot(...this.force.N)) ? '' : 'the force is not finite';
  }

  // withheld_ms: time from the last sign of life until zero force was sent, the last time that a thread paused.
  // The force that may go out now, N: within the limit; zero if there is a reason, and rising again over RAMP_MS after it.
  allowed(zero) {
    this.why = this.held();
    const now = performance.now();
    this.gain = zero || this.why ? 0 : Math.min(1, this.gain + (now - Math.max(this.sent_ms, now - 10)) / RAMP_MS);
    return this.gain ? this.force.N.map((f) => f * this.gain * Math.min(1, LIMIT_N / Math.max(LIMIT_N, Math.hypot(...this.force.N)))) : [0, 0, 0];
  }

  send(zero = false) {
    if (!this.known || this.socket.readyState !== WebSocket.OPEN) return;
    const [x, y, z] = this.allowed(zero).map((f) => Number(f.toFixed(5)));
    const session = !this.first ? {} : { session: { ...(this.since35 ? { configure: { profile: { name: 'tensormass' } } } : {}), force_render_full_state: {} } };
    const filters = this.first && this.since35 ? { configure: { force_gate: { gain: 0 }, damping: { scalar: 0 } } } : {};
    const commands = { set_cursor_force: { [this.since35 ? 'vector' : 'values']: { x, y, z } } };
    this.socket.send(JSON.stringify({ ...session, inverse3: [{ device_id: this.known, ...filters, commands }] }));
    if (this.sent_N > 0 && this.why) this.withheld_ms = Math.max(this.force.age_ms, this.page.age_ms);
    Object.assign(this, { first: false, under: this.under + 1, sent: this.sent + 1, trips: this.trips + (this.sent_N > 0 && this.why !== ''), sent_N: Math.hypot(x, y, z), sent_ms: performance.now() });
  }

  // Zero force at once: does not wait for an answer.
  stop() { this.enabled = false; this.send(true); }

  // Every LOOK_MS, without waiting for an answer: takes a force back, once, if it may go out no longer, or if the next one was not sent in time.
  look() {
    const now = performance.now();
    if (this.sent_N > 0 && (this.held() || now - this.sent_ms > FRESH_MS / 2)) this.send(true);
    if (this.known && now - this.last_ms > GONE_MS) this.close('the service is silent');
  }

  close(why = 'not connected') {
    this.send(true);
    this.closed = true;
    this.socket.close();
    this.tell(why);
  }
}

let device = null, law = null, page = null;

const messages = {
  // port: to the law's worker, which sends forces and receives the cursor. beats: from the page, which sends the time.
  open({ url, port, beats }) {
    messages.close();
    const force = new Newest(), alive = new Newest();
    [law, page] = [port, beats];
    law.onmessage = ({ data }) => force.take(data);
    page.onmessage = ({ data }) => alive.take({ N: null, at_ms: data });
    device = new Haply(url, {
      force, page: alive, tick: (tip_m, buttons, gain) => law.postMessage({ tip_m, buttons, gain }), tell: (text, refused = false) => postMessage({ kind: 'device', text, refused }),
    });
  },
  close() {
    device?.close();
    law?.close();
    page?.close();
    device = law = page = null;
  },
  hidden({ value }) {
    if (!device) return;
    if (value) device.stop();
    else device.enabled = true;
  },
};
onmessage = ({ data }) => messages[data.kind](data);
setInterval(() => { if (device) postMessage({ kind: 'sent', sent: device.sent, sent_N: device.sent_N ?? 0, why: device.why, trips: device.trips, withheld_ms: device.withheld_ms }); }, 100);
