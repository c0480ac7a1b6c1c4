// SPDX-License-Identifier: Apache-2.0
// The search runs in a worker, and browsers start none for a page that is read from the disk: there
// a hidden frame takes the worker's place.
if (location.protocol === 'file:') {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.frame = document.createElement('iframe');
      this.frame.hidden = true;
      this.ready = new Promise((resolve) => {
        this.frame.onload = resolve;
      });
      this.frame.srcdoc = '<script></script>';
      this.ready = this.ready.then(() => {
        const inner = this.frame.contentWindow;
        inner.postMessage = (data) => this.answer(data);
        inner.importScripts = (...urls) => Promise.all(urls.map((each) => this.load(each)));
        return this.load(url);
      });
      document.body.appendChild(this.frame);
    }

    load(url) {
      return new Promise((resolve, reject) => {
        const script = this.frame.contentDocument.createElement('script');
        Object.assign(script, { src: url, onload: resolve, onerror: reject });
        this.frame.contentDocument.body.appendChild(script);
      });
    }

    answer(data) {
      const event = new MessageEvent('message', { data });
      this.dispatchEvent(event);
      if (this.onmessage) this.onmessage(event);
    }

    postMessage(data) {
      this.ready.then(() => {
        const inner = this.frame.contentWindow;
        inner.dispatchEvent(new inner.MessageEvent('message', { data }));
      });
    }

    terminate() {
      this.frame.remove();
    }
  };
}
