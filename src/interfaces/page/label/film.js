// Displays the clip's pictures on a canvas. Loaded pictures are cached, and the next ones are loaded in advance.

const MAX_CACHED = 60;
const AHEAD = 6;

export class Film {
  constructor(canvas, shots, size) {
    Object.assign(this, { canvas, shots, size, kept: new Map(), wanted: -1 });
    [canvas.width, canvas.height] = size;
    this.dry = shots.findLastIndex((shot) => shot.phase === "dry");
  }

  // Returns the picture with this index, from 0.
  image(index) {
    let loading = this.kept.get(index);
    if (!loading) {
      loading = this.load(index);
      loading.catch(() => this.kept.delete(index));
    }
    // Move the picture to the end, so that the least recently used one is dropped first.
    this.kept.delete(index);
    this.kept.set(index, loading);
    for (const old of this.kept.keys()) {
      if (this.kept.size <= MAX_CACHED) break;
      this.kept.delete(old);
    }
    return loading;
  }

  async load(index) {
    const image = new Image();
    image.src = `picture/${index + 1}`;
    try {
      await image.decode();
    } catch {
      const answer = await fetch(image.src);
      const found = await answer.json().catch(() => null);
      throw new Error(found?.problems?.join("\n") ?? `picture ${index + 1} (${this.shots[index].file}) cannot be shown`);
    }
    if (image.naturalWidth !== this.size[0] || image.naturalHeight !== this.size[1]) {
      throw new Error(`picture ${index + 1} (${this.shots[index].file}) is ${image.naturalWidth}×${image.naturalHeight} px, ` +
        `but the clip's first picture is ${this.size[0]}×${this.size[1]} px`);
    }
    return image;
  }

  // Displays a picture, unless another picture is requested before this one is loaded.
  async show(index, how) {
    this.wanted = index;
    const isDry = how === "dry" && this.dry >= 0;
    const image = await this.image(isDry ? this.dry : index);
    const dry = how === "difference" && this.dry >= 0 ? await this.image(this.dry) : null;
    if (this.wanted !== index) return;
    const context = this.canvas.getContext("2d");
    context.globalCompositeOperation = "copy";
    context.drawImage(image, 0, 0);
    if (dry) {
      context.globalCompositeOperation = "difference";
      context.drawImage(dry, 0, 0);
    }
    const filters = { contrast2: "contrast(2)", contrast4: "contrast(4)", difference: "brightness(4)" };
    this.canvas.style.filter = filters[how] ?? "none";
    for (let ahead = 1; ahead <= AHEAD && index + ahead < this.shots.length; ahead += 1) this.image(index + ahead).catch(() => {});
  }
}
