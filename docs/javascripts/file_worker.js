// Browsers refuse workers to pages that are opened from a folder. There, the search runs in a hidden
// frame instead, which takes and gives messages as a worker does.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      frame.title = "search";
      document.body.appendChild(frame);
      this.inside = frame.contentWindow;
      const page = this.inside.document;
      page.open();
      page.write(`<!doctype html><title>search</title><body></body>`);
      page.close();
      this.inside.postMessage = (data) => this.answer(data);
      const script = page.createElement("script");
      this.ready = new Promise((resolve) => (script.onload = resolve));
      script.src = new URL(url, location.href).href;
      page.body.appendChild(script);
    }

    answer(data) {
      const message = new MessageEvent("message", { data });
      this.dispatchEvent(message);
      if (this.onmessage) this.onmessage(message);
    }

    postMessage(data) {
      const event = this.inside.MessageEvent;
      this.ready.then(() => this.inside.dispatchEvent(new event("message", { data })));
    }

    terminate() {
      this.inside.frameElement.remove();
    }
  };
}
