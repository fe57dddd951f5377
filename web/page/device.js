// Starts the worker that owns a Haply's socket, in a frame without an origin of its own: Chromium runs such a frame in another process, which goes on if this one is
// stopped. If the service refuses it there, the worker runs in this process.
import { $, law } from './state.js';

// The page's sign of life goes to the worker by a channel of its own, so that no other thread delays it. Browsers do not run a timer more often.
const BEAT_MS = 4;
// The frame's own text. It ends the worker, and with it the connection, when the browser freezes the page.
const FRAME = `<script>
let worker, port;
const start = (text) => {
  worker = new Worker(URL.createObjectURL(new Blob([text], { type: 'text/javascript' })));
  worker.onmessage = (e) => port.postMessage(e.data);
};
onmessage = (e) => {
  port = e.ports[0];
  start(e.data);
  port.onmessage = (m) => worker.postMessage(m.data, m.ports);
};
document.addEventListener('freeze', () => { worker?.terminate(); port.postMessage({ kind: 'device', text: 'the browser froze the page; connect again' }); });
<\/script>`;

let send = null, end = null, timer = 0, number = 0;

// Starts the worker in a frame; returns {send, end}.
async function inFrame(receive) {
  const frame = document.createElement('iframe'), channel = new MessageChannel(), text = await (await fetch('haply.worker.js')).text();
  frame.setAttribute('sandbox', 'allow-scripts');
  frame.allow = 'local-network-access *; local-network *; loopback-network *';
  frame.hidden = true;
  frame.title = 'Connection to the device';
  frame.srcdoc = FRAME;
  document.body.append(frame);
  await new Promise((loaded) => { frame.onload = loaded; });
  channel.port1.onmessage = ({ data }) => receive(data);
  frame.contentWindow.postMessage(text, '*', [channel.port2]);
  return { send: (message, ports) => channel.port1.postMessage(message, ports), end: () => { channel.port1.close(); frame.remove(); } };
}

function inWorker(receive) {
  const worker = new Worker(new URL('./haply.worker.js', import.meta.url));
  worker.onmessage = ({ data }) => receive(data);
  return { send: (message, ports) => worker.postMessage(message, ports), end: () => worker.terminate() };
}

export const device = {
  // receive(message): {kind: 'device', text} and {kind: 'sent', sent, sent_N, why}.
  async connect(url, receive, start = inFrame) {
    this.disconnect();
    const mine = ++number;
    let known = false;
    const taken = (message) => {
      known ||= /^Inverse3|inventory/.test(message.text ?? '');
      if (message.refused && !known && start === inFrame) this.connect(url, receive, inWorker);
      else receive(message);
    };
    const channel = new MessageChannel(), beats = new MessageChannel(), started = await start(taken);
    if (mine !== number) return started.end(); // disconnected meanwhile
    ({ send, end } = started);
    law.postMessage({ kind: 'device', port: channel.port1 }, [channel.port1]);
    send({ kind: 'open', url, port: channel.port2, beats: beats.port2 }, [channel.port2, beats.port2]);
    timer = setInterval(() => beats.port1.postMessage(performance.now()), BEAT_MS);
  },
  disconnect() {
    number++;
    clearInterval(timer);
    send?.({ kind: 'close' });
    const over = end;
    if (over) setTimeout(over, 200); // the zero force goes out first
    send = end = null;
    law.postMessage({ kind: 'device', port: null });
  },
  hidden(value) { send?.({ kind: 'hidden', value }); },
};
