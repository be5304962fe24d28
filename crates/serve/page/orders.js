// Sends orders of the operator to the server and shows their refusals.
//
// Invariant: an order carries the turn and the state that the operator saw when it was given, and is sent once.

/** Sender of orders. */
export class OrderSender {
  constructor(connection, store, notices) {
    Object.assign(this, { connection, store, notices });
  }

  /** Sends an order in the words of the scripted operator. Resolves with whether the machine took it. */
  async send(words) {
    const { store } = this;
    if (!store.isLive) return this.refuse('there is no link to the machine', 'Wait until the link is back.');
    if (!store.isHolder) return this.refuse('this page is not in control', 'Take control in the state line.');
    const answer = await this.connection.ask({ t: 'do', turn: store.control.turn, seen: store.state?.n ?? 0, words });
    if (answer.t === 'refused') this.notices.refuse(answer);
    if (answer.t === 'lost') {
      return this.refuse(`the link broke before \u201c${words}\u201d was answered`, 'It is not sent again.');
    }
    return answer.t === 'done';
  }

  refuse(cause, remedy) {
    this.notices.refuse({ cause, remedy });
    return false;
  }

  /** Feed hold. Needs no control and is never refused. */
  hold() {
    if (!this.connection.hold()) {
      this.notices.refuse({
        cause: 'HOLD could not be sent: there is no link.',
        remedy: 'It is tried for ten seconds. Use the switch of the machine if it must stand now.',
      });
    }
  }

  /** Turns the handwheel. */
  turnWheel(counts) {
    const { store } = this;
    return store.isHolder && this.connection.send({ t: 'wheel', turn: store.control.turn, counts });
  }

  /** Starts a continuous jog. Resolves with whether it runs. */
  async startJog(axis, up, speed, beat) {
    const { store } = this;
    if (!store.isHolder) return this.refuse('this page is not in control', 'Take control in the state line.');
    const message = { t: 'jog', turn: store.control.turn, seen: store.state?.n ?? 0, axis, up, speed, beat };
    const answer = await this.connection.ask(message);
    if (answer.t === 'refused') this.notices.refuse(answer);
    return answer.t === 'done';
  }

  beat(beat) {
    this.connection.send({ t: 'beat', beat });
  }

  endJog() {
    this.connection.send({ t: 'jog_end' });
  }

  /** Sends `take`, `give`, `keep` or `release`. */
  control(request) {
    this.connection.send({ t: 'control', do: request });
  }

  /** Asks which line made a record, or which records a line made. Resolves with the answer or null. */
  async locate(where) {
    const path = this.store.path?.path ?? this.store.state?.program?.path;
    if (path === undefined || path === null) return null;
    const answer = await this.connection.ask({ t: 'where', path, ...where });
    return answer.t === 'where' && answer.line !== null && answer.records ? answer : null;
  }
}
