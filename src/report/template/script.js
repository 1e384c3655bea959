/* Values under the pointer. The page is complete without it. */
(() => {
  const box = document.getElementById("readout");
  const number = (v, digits = 4) => {
    if (!Number.isFinite(v)) return "—";
    if (v === 0) return "0";
    const size = Math.abs(v);
    const text = size >= 1e-3 && size < 1e6 ? v.toPrecision(digits) : v.toExponential(digits - 1);
    return text.replaceAll("-", "−");
  };
  const angle = (v) => v.toFixed(2).replace("-", "−");
  const show = (event, text) => {
    box.textContent = text;
    box.hidden = false;
    const { width, height } = box.getBoundingClientRect();
    const x = Math.min(event.clientX + 14, innerWidth - width - 6);
    const y = event.clientY - height - 12;
    box.style.left = `${Math.max(4, x)}px`;
    box.style.top = `${y > 4 ? y : event.clientY + 18}px`;
  };
  const hide = () => { box.hidden = true; };

  const parseCsv = (text) => {
    const rows = [[""]];
    let quoted = false;
    for (let i = 0; i < text.length; i++) {
      const c = text[i];
      const row = rows[rows.length - 1];
      if (quoted) {
        if (c === '"' && text[i + 1] === '"') { row[row.length - 1] += '"'; i++; }
        else if (c === '"') quoted = false;
        else row[row.length - 1] += c;
      } else if (c === '"') quoted = true;
      else if (c === ",") row.push("");
      else if (c === "\n") rows.push([""]);
      else row[row.length - 1] += c;
    }
    rows.pop();
    return rows;
  };
  const tables = new Map();
  const table = (figure) => {
    if (!tables.has(figure)) {
      const link = figure && figure.querySelector("a.csv");
      const uri = link ? link.getAttribute("href") : ",";
      const rows = parseCsv(decodeURIComponent(uri.slice(uri.indexOf(",") + 1)));
      tables.set(figure, { columns: rows[0] || [], rows: rows.slice(1) });
    }
    return tables.get(figure);
  };

  const loaded = new Map();
  const pixels = (source, columns, rows) => {
    if (!loaded.has(source)) {
      loaded.set(source, null);
      const image = new Image();
      image.onload = () => {
        const canvas = document.createElement("canvas");
        canvas.width = columns;
        canvas.height = rows;
        const context = canvas.getContext("2d", { willReadFrequently: true });
        context.drawImage(image, 0, 0);
        loaded.set(source, context.getImageData(0, 0, columns, rows).data);
      };
      image.src = source;
    }
    return loaded.get(source);
  };
  const palettes = new Map();
  const palette = (name) => {
    if (!palettes.has(name)) {
      const colours = document.getElementById(`${name}-h`).dataset.colours;
      const map = new Map();
      for (let k = 0; k < 255; k++) map.set(colours.slice(6 * k, 6 * k + 6), k / 254);
      palettes.set(name, map);
    }
    return palettes.get(name);
  };
  const hex = (v) => v.toString(16).padStart(2, "0");

  const cell = (image, column, row) => {
    const columns = +image.getAttribute("width");
    const rows = +image.getAttribute("height");
    const d = image.dataset;
    if (d.values) {
      const scaled = [Math.floor((column + 0.5) / columns * d.columns), Math.floor((row + 0.5) / rows * d.rows)];
      const at = 4 * (scaled[1] * d.columns + scaled[0]);
      const p = pixels(d.values, +d.columns, +d.rows);
      if (!p) return "…";
      if (p[at + 2] === 0) return "not seen";
      const t = ((p[at] << 4) | (p[at + 1] >> 4)) / 4095;
      const value = +d.p0 + (d.p1 - d.p0) * t * t;
      const sigma = d.s0 * Math.pow(d.s1 / d.s0, (p[at + 2] - 1) / 254);
      return `${number(value)} ± ${number(sigma, 2)}`;
    }
    const at = 4 * (row * columns + column);
    const p = pixels(image.getAttribute("href"), columns, rows);
    if (!p) return "…";
    if (p[at + 3] === 0) return "not seen";
    const t = palette(d.map).get(hex(p[at]) + hex(p[at + 1]) + hex(p[at + 2]));
    if (t === undefined) return "—";
    const [low, high] = [+d.v0, +d.v1];
    if (d.spacing === "log") return `≈ ${number(low * Math.pow(high / low, t))}`;
    return `≈ ${number(low + (high - low) * (d.spacing === "root" ? t * t : t))}`;
  };

  /* The photo and the pixel that look at the point α in the direction nearest to θo′, radians and pixels. */
  const camera = document.getElementById("camera");
  const seenBy = (alpha, local) => {
    const { columns, rows } = table(document.getElementById("setup"));
    const at = (row, name) => row[columns.indexOf(name)];
    const radians = (deg) => deg * Math.PI / 180;
    const [radius, distance] = camera ? [+camera.dataset.radius, +camera.dataset.distance] : [0, 0];
    const a = radians(alpha);
    let best = null;
    for (const row of rows) {
      const orbit = radians(+at(row, "orbit_deg"));
      const parallel = !(camera && camera.dataset.focal);
      const exitant = parallel ? orbit : Math.atan2(
        distance * Math.sin(orbit) - radius * Math.sin(a), distance * Math.cos(orbit) - radius * Math.cos(a));
      const turn = exitant - a - radians(local);
      const off = Math.abs(Math.atan2(Math.sin(turn), Math.cos(turn)));
      if (!best || off < best.off) best = { row, off, orbit, parallel };
    }
    if (!best) return null;
    let text = `view ${at(best.row, "view")}, ${at(best.row, "file")}`;
    const side = radius * Math.sin(a - best.orbit);
    const scale = best.parallel ? camera && camera.dataset.width / camera.dataset.across
      : +camera.dataset.focal / (distance - radius * Math.cos(a - best.orbit));
    if (Number.isFinite(scale) && scale > 0) {
      const roll = radians(+at(best.row, "plane_roll_deg"));
      const x = +at(best.row, "centre_x_px") + scale * side * Math.cos(roll);
      const y = +at(best.row, "centre_y_px") - scale * side * Math.sin(roll);
      text += `\nnear pixel ${x.toFixed(0)}, ${y.toFixed(0)}`;
    }
    return text;
  };

  const readImage = (event, area, fx, fy) => {
    const d = area.dataset;
    const image = document.getElementById(d.image);
    const columns = +image.getAttribute("width");
    const rows = +image.getAttribute("height");
    const column = Math.min(columns - 1, Math.floor(fx * columns));
    const row = Math.min(rows - 1, Math.floor(fy * rows));
    const x = +d.x0 + (d.x1 - d.x0) * (column + 0.5) / columns;
    const y = +d.y1 - (d.y1 - d.y0) * (row + 0.5) / rows;
    const value = cell(image, column, row);
    if (d.image.startsWith("image-coefficients")) {
      show(event, `p ${Math.round(x)}, q ${Math.round(y)}\n|Bpq| ${value}`);
      return;
    }
    if (d.image.startsWith("image-brdf")) {
      show(event, `θi′ ${angle(x)}°, θo′ ${angle(y)}°\n${value}`);
      return;
    }
    let text = `α ${angle(x)}°, θo′ ${angle(y)}°\n${value}`;
    const from = value === "not seen" || value === "…" ? null : seenBy(x, y);
    if (from !== null) text += `\n${from}`;
    show(event, text);
  };

  const readCurve = (event, area, fx) => {
    const d = area.dataset;
    const figure = area.closest("figure");
    if (!figure) return;
    const { columns, rows } = table(figure);
    const xColumn = columns.indexOf(d.curve);
    if (xColumn < 0) return;
    const log = d.xSpacing === "log";
    const x = log ? d.x0 * Math.pow(d.x1 / d.x0, fx) : +d.x0 + (d.x1 - d.x0) * fx;
    const panel = area.closest(".panel").querySelector(".panel-name");
    const channelColumn = columns.indexOf("channel");
    const name = panel && panel.dataset.channel;
    let nearest = [];
    let least = Infinity;
    for (const row of rows) {
      if (channelColumn >= 0 && name && row[channelColumn] !== name) continue;
      const off = log ? Math.abs(Math.log(row[xColumn] / x)) : Math.abs(row[xColumn] - x);
      if (off < least) [nearest, least] = [[], off];
      if (off === least) nearest.push(row);
    }
    if (!nearest.length) return;
    const words = (row, i) => {
      const raw = row[i];
      const text = raw !== "" && Number.isFinite(+raw) ? number(+raw) : raw || "—";
      const sigma = columns[i].startsWith("L_") ? columns.indexOf(`sigma_${columns[i].slice(2)}`) : -1;
      return `${columns[i].replace("_deg", " / degrees")}  ${text}${sigma >= 0 ? ` ± ${number(+row[sigma], 2)}` : ""}`;
    };
    const others = columns.map((_, i) => i)
      .filter((i) => i !== xColumn && i !== channelColumn && !columns[i].startsWith("sigma_"));
    // Several curves over the same axis: a line for each.
    const lines = nearest.map((row) => others.map((i) => words(row, i)).join(nearest.length > 1 ? ",  " : "\n"));
    show(event, [words(nearest[0], xColumn), ...lines].join("\n"));
  };

  /* A cross where the values are read; event has clientX and clientY. */
  const read = (event, area, fx, fy) => {
    const [x, y] = zoom.at(area, fx, fy);
    if (area.dataset.image) readImage(event, area, x, y);
    else readCurve(event, area, x);
    mark(area, fx, area.dataset.image ? fy : null);
  };
  const cross = document.createElementNS("http://www.w3.org/2000/svg", "path");
  cross.setAttribute("class", "cursor");
  const mark = (area, fx, fy) => {
    const [x, y, w, h] = ["x", "y", "width", "height"].map((name) => +area.getAttribute(name));
    cross.setAttribute("d", `M${x + fx * w} ${y}v${h}` + (fy === null ? "" : `M${x} ${y + fy * h}h${w}`));
    area.before(cross);
  };
  const away = () => { hide(); cross.remove(); };

  document.addEventListener("pointermove", (event) => {
    const area = event.target instanceof Element ? event.target.closest(".area") : null;
    if (!area || !(area.dataset.image || area.dataset.curve)) { away(); return; }
    const r = area.getBoundingClientRect();
    if (!(r.width > 0 && r.height > 0)) { away(); return; }
    const fx = Math.min(1, Math.max(0, (event.clientX - r.left) / r.width));
    const fy = Math.min(1, Math.max(0, (event.clientY - r.top) / r.height));
    read(event, area, fx, fy);
  });

  /* The same by keyboard: a plot in focus is read with the arrow keys, Shift for larger steps; + and − zoom, 0 shows all. */
  for (const area of document.querySelectorAll("svg > .area")) area.parentElement.tabIndex = 0;
  const cursors = new WeakMap();
  document.addEventListener("keydown", (event) => {
    const area = event.target instanceof SVGElement ? zoom.areaOf(event.target) : null;
    if (!area || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key === "Escape") { away(); return; }
    let at = cursors.get(area) || [0.5, 0.5];
    const readable = area.dataset.image || area.dataset.curve;
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (event.key === "+" || event.key === "=") zoom.by(area, 2, ...at);
    else if (event.key === "-") zoom.by(area, 0.5, ...at);
    else if (event.key === "0") zoom.all(area);
    else if (way && readable) {
      const image = document.getElementById(area.dataset.image);
      const cells = image ? [+image.getAttribute("width"), +image.getAttribute("height")] : [180, 1];
      const shown = zoom.view(area).slice(2);
      const steps = event.shiftKey ? 10 : 1;
      at = at.map((v, k) => Math.min(1 - 1e-6, Math.max(0, v + way[k] * steps / (cells[k] * shown[k]))));
      cursors.set(area, at);
    } else return;
    event.preventDefault();
    if (!readable) return;
    const r = area.getBoundingClientRect();
    read({ clientX: r.left + at[0] * r.width, clientY: r.top + at[1] * r.height }, area, ...at);
  });
  document.addEventListener("focusout", (event) => { if (event.target instanceof SVGElement) away(); });

  /* A drawing enlarged, to be scrolled: pointer or keyboard, closed by Escape. */
  for (const figure of document.querySelectorAll("figure")) {
    if (!figure.querySelector(".panel svg:not(.store)")) continue;
    const tools = document.createElement("p");
    tools.className = "tools";
    const tool = (words, act) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = words;
      button.addEventListener("click", act);
      tools.append(button);
      return button;
    };
    const areas = () => [...figure.querySelectorAll("svg > .area")].filter((area) => area.getBoundingClientRect().width > 0);
    const each = (act) => () => areas().forEach((area) => act(area));
    const button = tool("Enlarge", () => {
      const dialog = document.createElement("dialog");
      dialog.className = "large";
      const close = document.createElement("button");
      close.type = "button";
      close.textContent = "Close";
      close.addEventListener("click", () => dialog.close());
      dialog.append(close);
      for (const drawing of figure.querySelectorAll(".panel svg:not(.store)")) {
        if (drawing.parentElement.closest("svg") || drawing.getBoundingClientRect().width === 0) continue;
        const copy = drawing.cloneNode(true);
        copy.removeAttribute("class");
        dialog.append(copy);
      }
      dialog.addEventListener("close", () => { away(); document.body.append(box); dialog.remove(); button.focus(); });
      document.body.append(dialog);
      dialog.showModal();
      dialog.append(box);
    });
    const data = figure.querySelector("details.data");
    if (figure.querySelector("svg > .area")) {
      tool("Zoom in", each((area) => zoom.by(area, 2, ...(cursors.get(area) || []))));
      tool("Zoom out", each((area) => zoom.by(area, 0.5, ...(cursors.get(area) || []))));
      tool("Show all", each(zoom.all));
    }
    if (data) data.before(tools); else figure.append(tools);
  }

  document.addEventListener("pointerleave", away);
  addEventListener("scroll", away, { passive: true });

  /* Tables of class sortable are sorted by the keys of a column; rows without a key stay at the end. */
  for (const table of document.querySelectorAll("table.sortable")) {
    const heads = [...table.tHead.rows[0].cells];
    heads.forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = head.textContent;
      head.textContent = "";
      head.append(button);
      button.addEventListener("click", () => {
        const up = head.getAttribute("aria-sort") !== "ascending";
        for (const other of heads) other.removeAttribute("aria-sort");
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        const key = (row) => row.cells[column].dataset.key;
        const rows = [...table.tBodies[0].rows];
        const numeric = rows.every((row) => key(row) === "" || Number.isFinite(+key(row)));
        rows.sort((a, b) => {
          const [x, y] = [key(a), key(b)];
          if (x === "" || y === "") return (x === "") - (y === "");
          const order = numeric ? x - y : x.localeCompare(y, "en", { numeric: true });
          return up ? order : -order;
        });
        table.tBodies[0].append(...rows);
      });
    });
  }

  const first = document.querySelector("figure:has(svg > .area)");
  if (first) {
    const hint = document.createElement("p");
    hint.className = "hint";
    hint.textContent = "Plots: the pointer, or the arrow keys in a plot, read values; a rectangle drawn with the mouse, or + and −, zoom in; a double click, or 0, shows the whole.";
    (first.closest(".figures") || first).before(hint);
  }

  /* A channel chosen in one figure is chosen in all that have it; a scale in all panels of its figure. */
  document.addEventListener("change", (event) => {
    const input = event.target;
    if (!(input instanceof HTMLInputElement) || input.type !== "radio") return;
    const name = input.nextElementSibling.textContent;
    const scope = input.name.endsWith("-scale") ? input.closest("figure") : document;
    for (const other of scope.querySelectorAll(".switch input")) {
      if (other.nextElementSibling.textContent === name) other.checked = true;
    }
  });
})();
