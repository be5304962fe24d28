// Holds the newest of everything the server reports, and notifies the parts of the page of changes.
//
// Invariant: only messages of the server change it; no part of the page writes a state that it expects.

const TOPICS = ['hello', 'state', 'live', 'log', 'control', 'path', 'rejected', 'offer'];

/** Newest state of the machine. */
export class MachineStore {
  constructor() {
    this.hello = this.state = this.live = this.log = this.control = this.path = null;
    this.link = 'opening';
    this.chosen = null;
    this.framed = null;
    this.listeners = new Map();
  }

  /** Calls the listener after each change of one of the topics (separated by spaces). */
  on(topics, listener) {
    for (const topic of topics.split(' ')) {
      if (!this.listeners.has(topic)) this.listeners.set(topic, new Set());
      this.listeners.get(topic).add(listener);
    }
  }

  emit(topic) {
    for (const listener of this.listeners.get(topic) ?? []) listener(this[topic]);
  }

  /** Applies a message of the server. */
  apply(message) {
    if (!TOPICS.includes(message.t)) return;
    this[message.t] = message;
    this.emit(message.t);
  }

  setLink(link) {
    this.link = link;
    if (link === 'lost' || link === 'signed-out') this.control = null;
    this.emit('link');
  }

  /** Line and records that the user has chosen, or null. */
  choose(chosen) {
    this.chosen = chosen;
    this.emit('chosen');
  }

  /** Extents in X and in Y that a frame goes round, or null. */
  showFrame(extents) {
    this.framed = extents;
    this.emit('framed');
  }

  get isLive() {
    return this.link === 'live';
  }

  /** Whether this page may give orders: it has the right, the control and a link. */
  get isHolder() {
    return this.isLive && this.hello?.rights === 'operate' && this.control?.is_you === true;
  }

  /** Whether the server offers an action now, to whoever is in control. */
  offers(id) {
    return this.isLive && this.state?.can?.includes(id) === true;
  }

  /** Whether this page may carry out an action now. */
  allows(id) {
    return this.isHolder && this.offers(id);
  }

  /** Whether no job runs. */
  get isSetup() {
    return this.state?.stage === 'setup' || this.state?.stage === 'ended';
  }

  axis(index) {
    return this.hello?.machine.axes[index];
  }
}
