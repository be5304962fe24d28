// Keeps the session and the WebSocket to the server.
//
// Invariant: nothing is ever sent twice, and nothing that was not sent before a reconnection is sent after it. The
// only exception is HOLD, which is tried for ten seconds, because holding is always safe.

const PROTOCOL = 'retrace.1';
const SILENCE_MS = 500;
const HOLD_RETRY_MS = 10_000;
const MAX_BACK_OFF_MS = 5_000;

/** Error of a request, with number, cause and remedy. */
export class RequestError extends Error {
  constructor(status, error) {
    super(error?.cause ?? `the server answered with ${status}`);
    this.status = status;
    this.number = error?.number ?? '';
    this.cause = this.message;
    this.remedy = error?.remedy ?? '';
  }
}

/** Link to the server. `onLink` gets `opening`, `live`, `silent`, `lost` or `signed-out`. */
export class Connection {
  constructor({ onMessage, onChunk, onLink }) {
    Object.assign(this, { onMessage, onChunk, onLink });
    this.link = 'opening';
    this.socket = null;
    this.heard = 0;
    this.backOffMs = 250;
    this.nextId = 1;
    this.answers = new Map();
    this.holdWantedUntil = 0;
    this.sessions = 0;
  }

  /** Exchanges the token of the address, if there is one, for a session, and connects. */
  async start() {
    setInterval(() => this.checkSilence(), 100);
    addEventListener('online', () => this.link === 'lost' && this.open());
    const token = /[#&]t=([^&]+)/.exec(location.hash)?.[1];
    if (token) {
      history.replaceState(null, '', location.pathname + location.search);
      try {
        await this.signIn(decodeURIComponent(token));
        return;
      } catch {
        /* an old cookie may still be good */
      }
    }
    this.open();
  }

  /** Exchanges a token for a session, and connects. */
  async signIn(token) {
    await this.request('POST', '/api/v1/session', { token });
    this.open();
  }

  /** Ends the session. */
  async signOut() {
    await this.request('DELETE', '/api/v1/session').catch(() => null);
    this.setLink('signed-out');
    this.socket?.close();
  }

  setLink(link) {
    if (this.link === link) return;
    this.link = link;
    this.onLink(link);
  }

  open() {
    clearTimeout(this.reopen);
    if (this.socket && this.socket.readyState <= WebSocket.OPEN) return;
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const socket = (this.socket = new WebSocket(`${scheme}://${location.host}/api/v1/ws`, [PROTOCOL]));
    socket.binaryType = 'arraybuffer';
    let opened = false;
    socket.onopen = () => {
      opened = true;
      this.sessions++;
      this.backOffMs = 250;
      this.heard = performance.now();
      if (performance.now() < this.holdWantedUntil) this.sendText({ t: 'hold' });
      this.holdWantedUntil = 0;
    };
    socket.onmessage = ({ data }) => {
      this.heard = performance.now();
      this.setLink('live');
      if (typeof data !== 'string') this.onChunk(data);
      else this.receive(JSON.parse(data));
    };
    socket.onclose = () => {
      if (this.socket !== socket) return;
      this.socket = null;
      for (const answer of this.answers.values()) answer({ t: 'lost' });
      this.answers.clear();
      if (this.link === 'signed-out') return;
      this.setLink('lost');
      if (opened) this.openLater();
      else this.checkSession();
    };
  }

  openLater() {
    this.reopen = setTimeout(() => this.open(), this.backOffMs);
    this.backOffMs = Math.min(this.backOffMs * 2, MAX_BACK_OFF_MS);
  }

  async checkSession() {
    try {
      await this.request('GET', '/api/v1/hello');
    } catch (error) {
      if (error.status === 401 || error.status === 403) {
        this.setLink('signed-out');
        return;
      }
    }
    this.openLater();
  }

  checkSilence() {
    if (this.link === 'live' && performance.now() - this.heard > SILENCE_MS) this.setLink('silent');
  }

  receive(message) {
    const answer = this.answers.get(message.id);
    if (answer && ['done', 'refused', 'where'].includes(message.t)) {
      this.answers.delete(message.id);
      answer(message);
    } else {
      this.onMessage(message);
    }
  }

  sendText(message) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  /** Sends a message that needs no answer. Returns whether it was sent; it is never kept for later. */
  send(message) {
    return this.link === 'live' && this.sendText(message);
  }

  /** Sends a message with a number and resolves with its answer, or with `{t: 'lost'}`. */
  ask(message) {
    const id = this.nextId++;
    return new Promise(resolve => {
      if (this.send({ ...message, id })) this.answers.set(id, resolve);
      else resolve({ t: 'lost' });
    });
  }

  /** Sends a feed hold at once. Without a link it is sent as soon as there is one, for ten seconds. */
  hold() {
    if (this.sendText({ t: 'hold' })) return true;
    this.holdWantedUntil = performance.now() + HOLD_RETRY_MS;
    if (this.link === 'lost') this.open();
    return false;
  }

  /** Makes a request and resolves with the JSON of its answer. Fails with a `RequestError`. */
  async request(method, path, body, headers = {}) {
    return (await this.exchange(method, path, body, headers)).value;
  }

  /** Reads a table and resolves with `{value, version}`. Fails with a `RequestError`. */
  read(path) {
    return this.exchange('GET', path);
  }

  async exchange(method, path, body, headers = {}) {
    const isText = typeof body === 'string' || body instanceof Blob;
    const options = { method, headers: { ...headers }, credentials: 'same-origin', cache: 'no-store' };
    if (body !== undefined) {
      options.body = isText ? body : JSON.stringify(body);
      options.headers['Content-Type'] ??= isText ? 'text/plain; charset=utf-8' : 'application/json';
    }
    let response;
    try {
      response = await fetch(path, options);
    } catch {
      throw new RequestError(0, {
        cause: 'the server does not answer',
        remedy: 'Check the link to the machine.',
      });
    }
    const text = await response.text();
    let value = null;
    try {
      value = text ? JSON.parse(text) : null;
    } catch {
      /* not every answer has a body */
    }
    if (!response.ok) throw new RequestError(response.status, value?.error);
    return { value, version: response.headers.get('ETag') };
  }
}
