// Markers in 3-D on a canvas: drag to turn, scrub in time. The page loads nothing else.
for (const root of document.querySelectorAll(".scene")) {
  const { speed, parts } = JSON.parse(root.querySelector("script").textContent);
  const [canvas, slider, which, play, told] =
    ["canvas", "input", "select", "button", "output"].map((name) => root.querySelector(name));
  const pen = canvas.getContext("2d");
  const colours = ["#0072b2", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#d55e00"];
  const bytes = (text) => Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0)).buffer;
  let printing = false, yaw = 0.6, pitch = 0.25, zoom = 1, part, last = null;

  function take(number) {
    const { markers, roles, looks, contacts, middle, step, ...one } = parts[number];
    const time = new Float32Array(bytes(one.time)), steps = new Int16Array(bytes(one.places));
    const at = (frame, marker) => {
      const from = 3 * (frame * markers.length + marker);
      return steps[from] === -32768 ? null : middle.map((m, axis) => m + step * steps[from + axis]);
    };
    const of = (role) => roles.flatMap((own, marker) => (own === role ? [marker] : []));
    const feet = of("foot"), body = of("body"), all = markers.map((_, marker) => marker);
    let size = 0.05;
    for (let frame = 0; frame < time.length; frame += 10) {
      const [x, y, z] = centre(at, frame, body.length ? body : all) ?? middle;
      for (const marker of all) {
        const place = at(frame, marker);
        if (place) size = Math.max(size, Math.hypot(place[0] - x, place[1] - y, place[2] - z));
      }
    }
    part = { time, at, looks, feet, body, all, markers, contacts, middle, size };
    slider.max = time.length - 1;
    slider.value = Math.max(0, time.findIndex((t) => t >= Math.min(...contacts.filter((c) => c !== null))));
    draw();
  }

  function centre(at, frame, markers) {
    const seen = markers.map((marker) => at(frame, marker)).filter(Boolean);
    return seen.length ? [0, 1, 2].map((k) => seen.reduce((sum, place) => sum + place[k], 0) / seen.length) : null;
  }

  function draw() {
    const { time, at, looks, feet, body, all, markers, contacts, middle, size } = part, frame = +slider.value;
    const dots = devicePixelRatio || 1, { width, height } = canvas.getBoundingClientRect();
    canvas.width = width * dots;
    canvas.height = height * dots;
    pen.setTransform(dots, 0, 0, dots, 0, 0);
    const ink = printing ? "#1c1c1c" : getComputedStyle(canvas).color, scale = (zoom * 0.42 * Math.min(width, height)) / size;
    const [cx, cy, cz] = centre(at, frame, body.length ? body : all) ?? middle;
    const foot = Math.min(...feet.map((marker) => at(frame, marker)?.[2] ?? Infinity));
    const low = Math.min(0, Number.isFinite(foot) ? foot : 0), level = feet.length ? cz - 0.45 * size : cz;
    const project = ([x, y, z]) => {
      const [a, b] = [x - cx, y - cy], c = Math.cos(yaw), s = Math.sin(yaw);
      const depth = s * a + c * b;
      return [
        width / 2 + scale * (c * a - s * b),
        height / 2 - scale * (Math.cos(pitch) * (z - level) + Math.sin(pitch) * depth),
      ];
    };
    const line = (one, two, colour, thick, fade = 1) => {
      if (!one || !two) return;
      pen.globalAlpha = fade;
      pen.strokeStyle = colour;
      pen.lineWidth = thick;
      pen.beginPath();
      pen.moveTo(...project(one));
      pen.lineTo(...project(two));
      pen.stroke();
      pen.globalAlpha = 1;
    };
    const cell = 10 ** Math.floor(Math.log10(size)), [gx, gy] = [cx, cy].map((v) => Math.round(v / cell) * cell);
    const reach = Math.min(12, Math.ceil((1.2 * size) / cell));
    for (let k = -reach; k <= reach; k++) {
      line([gx + k * cell, gy - reach * cell, 0], [gx + k * cell, gy + reach * cell, 0], ink, 1, 0.15);
      line([gx - reach * cell, gy + k * cell, 0], [gx + reach * cell, gy + k * cell, 0], ink, 1, 0.15);
    }
    for (const one of body) for (const two of body) if (one < two) line(at(frame, one), at(frame, two), ink, 3, 0.5);
    const hub = centre(at, frame, body), now = time[frame];
    const order = contacts.map((t, n) => [t, n]).filter(([t]) => t !== null).sort((p, q) => p[0] - q[0]);
    const names = [];
    pen.font = "13px sans-serif";
    for (const marker of all) {
      const place = at(frame, marker), number = feet.indexOf(marker);
      const colour = number < 0 ? ink : colours[looks[number] % 6];
      if (number >= 0) {
        for (let k = Math.max(1, frame - 30); k <= frame; k++) line(at(k - 1, marker), at(k, marker), colour, 2, 0.35);
        line(hub, place, colour, 1.5, 0.6);
      }
      if (!place) continue;
      const [x, y] = project(place), rank = order.findIndex(([, n]) => n === number);
      pen.fillStyle = pen.strokeStyle = colour;
      pen.beginPath();
      pen.arc(x, y, number < 0 ? 4 : 6, 0, 7);
      pen.fill();
      if (number >= 0 && rank >= 0 && contacts[number] <= now) {
        pen.lineWidth = 2;
        pen.beginPath();
        pen.arc(x, y, 10, 0, 7);
        pen.stroke();
      }
      if (number >= 0 || !feet.length) {
        const down = rank >= 0 && contacts[number] <= now ? `${rank + 1}. ` : "";
        names.push([x + 12, y + 4, down + markers[marker]]);
      }
    }
    // Stack the names of feet that are close together.
    pen.fillStyle = ink;
    names.sort((one, other) => one[1] - other[1]).forEach((own, k) => {
      const [x, , name] = own, end = x + pen.measureText(name).width;
      for (const [left, line, above] of feet.length ? names.slice(0, k) : [])
        if (own[1] < line + 14 && x < left + pen.measureText(above).width && left < end) own[1] = line + 14;
      pen.fillText(name, x, own[1]);
    });
    const touched = order.filter(([t]) => t <= now).map(([t, n], k) => `${k + 1}. ${markers[feet[n]]} ${(1e3 * (t - order[0][0])).toFixed(1)} ms`);
    const height_mm = hub ? `, body at ${(1e3 * hub[2]).toFixed(0)} mm` : "";
    const from = order.length ? " from the pre section" : "";
    told.textContent = `${now.toFixed(3)} s${from}${height_mm}${touched.length ? `; down: ${touched.join(", ")}` : ""}`;
    slider.setAttribute("aria-valuetext", `${now.toFixed(3)} s`);
  }

  function run(stamp) {
    if (last === null) return;
    const { time } = part, wanted = time[+slider.value] + (speed * (stamp - last)) / 1000;
    const next = time.findIndex((t) => t >= wanted);
    if (next > +slider.value || next < 0) {
      slider.value = next < 0 ? 0 : next;
      last = stamp;
      draw();
    }
    requestAnimationFrame(run);
  }

  parts.forEach((one, number) => which.add(new Option(one.title, number)));
  which.parentNode.hidden = parts.length < 2;
  which.addEventListener("change", () => take(+which.value));
  slider.addEventListener("input", draw);
  play.addEventListener("click", () => {
    last = last === null ? performance.now() : null;
    play.textContent = last === null ? "Play" : "Stop";
    requestAnimationFrame(run);
  });
  const turn = (sideways, up) => {
    yaw += sideways;
    pitch = Math.max(-0.1, Math.min(1.57, pitch + up));
    draw();
  };
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => event.buttons && turn(-event.movementX / 120, event.movementY / 120));
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
    const factor = { "+": 1.2, "-": 1 / 1.2 }[event.key];
    if (!step && !factor) return;
    event.preventDefault();
    zoom *= factor ?? 1;
    turn(...(step ?? [0, 0]));
  });
  new ResizeObserver(() => part && draw()).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  // Paper is white, whatever the screen is.
  for (const when of ["beforeprint", "afterprint"]) addEventListener(when, () => ((printing = when === "beforeprint"), draw()));
  take(0);
}
