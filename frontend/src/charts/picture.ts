// A chart as a picture for another program: its drawing under its title, on the colours of the page.

const HEAD_PX = 30;

/** A drawing of `width` by `height` pixels of the page under a title, with the names of its lines in their colours. */
export async function picture(
  drawing: CanvasImageSource,
  width: number,
  height: number,
  title: string,
  style: CSSStyleDeclaration,
  lines: readonly { label: string; colour: string }[] = [],
): Promise<Blob | null> {
  const ratio = Math.max(2, devicePixelRatio);
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [width * ratio, (height + HEAD_PX) * ratio];
  const ctx = canvas.getContext('2d');
  if (!ctx) return null;
  ctx.scale(ratio, ratio);
  ctx.fillStyle = style.getPropertyValue('--surface');
  ctx.fillRect(0, 0, width, height + HEAD_PX);
  ctx.fillStyle = style.getPropertyValue('--ink');
  ctx.font = '500 13px Plex, sans-serif';
  ctx.fillText(title, 8, 20);
  let x = 8 + ctx.measureText(title).width;
  for (const { label, colour } of lines) {
    ctx.fillStyle = style.getPropertyValue(`--${colour}`);
    ctx.fillText(label, (x += 16), 20);
    x += ctx.measureText(label).width;
  }
  ctx.drawImage(drawing, 0, HEAD_PX, width, height);
  return new Promise((made) => canvas.toBlob(made, 'image/png'));
}

const DRAWN = [
  'fill',
  'fill-opacity',
  'stroke',
  'stroke-width',
  'stroke-dasharray',
  'font-size',
  'font-family',
];

/** An SVG of the page as an image that needs no style sheet. */
export async function imageOf(svg: SVGSVGElement): Promise<HTMLImageElement> {
  const clone = svg.cloneNode(true) as SVGSVGElement;
  clone.setAttribute('xmlns', 'http://www.w3.org/2000/svg');
  const copies = [...clone.querySelectorAll<SVGElement>('path, text')];
  [...svg.querySelectorAll('path, text')].forEach((from, i) => {
    const style = getComputedStyle(from);
    for (const name of DRAWN) copies[i]?.style.setProperty(name, style.getPropertyValue(name));
  });
  const image = new Image();
  image.src = `data:image/svg+xml,${encodeURIComponent(new XMLSerializer().serializeToString(clone))}`;
  await image.decode();
  return image;
}
