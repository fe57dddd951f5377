// A Haply Inverse3 by its service's WebSocket. The service speaks first (an inventory), then answers each message with one state.
// One message is under way at a time. A force goes out only if `force()` gives one that is fresh by this worker's own clock.
const FRESH_MS = 20, GONE_MS = 1000, PACE_MS = 1;

const vector = (x) => (x && [x.x, x.y, x.z].every(Number.isFinite) ? [x.x, x.y, x.z] : null);

export class Haply {
  // tick(cursor_m, buttons): called with every state. force(): {N: [3], at_ms: when it was computed, by performance.now()}. tell(text): for the page.
  constructor(url, limit_N, { tick, force, tell }) {
    Object.assign(this, { limit_N, tick, force, tell, known: null, first: true, under: 0, sent: 0, refused: 0, enabled: true, last_ms: performance.now() });
    this.socket = new WebSocket(url);
    this.socket.onopen = () => tell('connected; waiting for the inventory');
    this.socket.onmessage = ({ data }) => this.receive(data);
    this.socket.onclose = () => { this.known = null; clearInterval(this.watch); tell(this.closed ? 'not connected' : 'the service closed the connection, or none runs there; start the Haply Inverse Service'); };
    this.watch = setInterval(() => this.look(), 5);
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
    this.tick(cursor, { a: Boolean(buttons.a ?? grip?.button), b: Boolean(buttons.b) });
  }

  answered() {
    this.under = Math.max(0, this.under - 1);
    this.last_ms = performance.now();
    setTimeout(() => { if (!this.under) this.send(); }, PACE_MS);
  }

  // The force that may go out now, N: zero if it is not enabled, not finite or not fresh; within the limit.
  allowed(zero) {
    const { N, at_ms } = this.force(), size = Math.hypot(...N);
    if (zero || !this.enabled || !(performance.now() - at_ms < FRESH_MS) || !Number.isFinite(size)) return [0, 0, 0];
    return size > this.limit_N ? N.map((f) => (f * this.limit_N) / size) : N;
  }

  send(zero = false) {
    if (!this.known || this.socket.readyState !== WebSocket.OPEN) return;
    const [x, y, z] = this.allowed(zero).map((f) => Number(f.toFixed(5)));
    const session = !this.first ? {} : { session: { ...(this.since35 ? { configure: { profile: { name: 'tensormass' } } } : {}), force_render_full_state: {} } };
    const filters = this.first && this.since35 ? { configure: { force_gate: { gain: 0 }, damping: { scalar: 0 } } } : {};
    const commands = { set_cursor_force: { [this.since35 ? 'vector' : 'values']: { x, y, z } } };
    this.socket.send(JSON.stringify({ ...session, inverse3: [{ device_id: this.known, ...filters, commands }] }));
    Object.assign(this, { first: false, under: this.under + 1, sent: this.sent + 1, sent_N: Math.hypot(x, y, z), sent_ms: performance.now() });
  }

  // Zero force at once: does not wait for an answer.
  stop() { this.enabled = false; this.send(true); }

  // Every 5 ms: a force that grew old without an answer to send the next one on is taken back, once.
  look() {
    const now = performance.now();
    if (this.sent_N > 0 && now - this.sent_ms > FRESH_MS / 2) this.send(true);
    if (this.known && now - this.last_ms > GONE_MS) this.close('the service is silent');
  }

  close(why = 'not connected') {
    this.send(true);
    this.closed = true;
    this.socket.close();
    this.tell(why);
  }
}
