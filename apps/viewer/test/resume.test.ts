// SPDX-License-Identifier: Apache-2.0
import { afterEach, describe, expect, it, vi } from 'vitest';
import { readAll } from '../src/format/load';
import { resumed } from '../src/format/resume';

const FILE = Uint8Array.from({ length: 100 }, (_, i) => i);

/** Bytes of the file from `begin` on; after `most` of them the connection breaks. */
function body(begin: number, most = Infinity): ReadableStream<Uint8Array> {
  let at = begin;
  return new ReadableStream({
    pull(controller) {
      if (at - begin >= most) return controller.error(new TypeError('network error'));
      if (at >= FILE.length) return controller.close();
      controller.enqueue(FILE.slice(at, (at = Math.min(at + 7, FILE.length))));
    },
  });
}

const RANGES = { 'accept-ranges': 'bytes' };
const rest = (begin: number, most?: number) =>
  new Response(body(begin, most), { status: 206, headers: { 'content-range': `bytes ${begin}-99/100` } });

/** Serves what follows; returns what was asked. */
function serve(answer: (begin: number, request: number) => Response): Headers[] {
  const asked: Headers[] = [];
  vi.stubGlobal('location', { href: 'http://site/' });
  vi.stubGlobal('fetch', (_: string, { headers }: RequestInit) => {
    asked.push(new Headers(headers));
    const begin = Number(/^bytes=(\d+)-$/.exec(asked.at(-1)!.get('range')!)![1]);
    return Promise.resolve().then(() => answer(begin, asked.length));
  });
  return asked;
}

async function read(url: string, first: Response, signal = new AbortController().signal): Promise<number[]> {
  return [...new Uint8Array(await readAll({ name: 'f', parts: resumed(url, first, 100, signal, 1) }, () => undefined))];
}

afterEach(() => vi.unstubAllGlobals());

describe('a transfer that breaks', () => {
  it('goes on where it stopped, as often as it has to', async () => {
    const asked = serve((begin) => rest(begin, 20));
    expect(await read('a.ngsplat', new Response(body(0, 30), { headers: RANGES }))).toEqual([...FILE]);
    expect(asked.map((headers) => headers.get('range'))).toEqual(['bytes=35-', 'bytes=56-', 'bytes=77-', 'bytes=98-']);
    expect(asked[0].has('if-range')).toBe(false);
  });

  it('waits for a connection, but not for ever', async () => {
    const asked = serve((begin, request) => {
      if (request < 4) throw new TypeError('no connection');
      return rest(begin);
    });
    expect(await read('a.ngsplat', new Response(body(0, 30), { headers: RANGES }))).toEqual([...FILE]);
    expect(asked.length).toBe(4);
    serve(() => {
      throw new TypeError('no connection');
    });
    await expect(read('a.ngsplat', new Response(body(0, 30), { headers: RANGES }))).rejects.toThrow('network error');
  });

  it('is of the same file, or ends', async () => {
    let asked = serve((begin) => rest(begin));
    expect(await read('a.ply', new Response(body(0, 30), { headers: { ...RANGES, etag: '"x"' } }))).toEqual([...FILE]);
    expect(asked[0].get('if-range')).toBe('"x"');
    asked = serve((begin) => rest(begin));
    await read(
      'a.ply',
      new Response(body(0, 30), {
        headers: { ...RANGES, etag: 'W/"weak"', 'last-modified': 'Mon, 23 Nov 2026 10:00:00 GMT' },
      }),
    );
    expect(asked[0].get('if-range')).toBe('Mon, 23 Nov 2026 10:00:00 GMT');
    const others: [Response, string][] = [
      [new Response(body(0)), 'has another file by now'],
      [new Response(body(35), { status: 206, headers: { 'content-range': 'bytes 35-98/99' } }), 'does not go on'],
      [new Response(null, { status: 404 }), 'does not go on'],
    ];
    for (const [other, message] of others) {
      serve(() => other);
      await expect(read('a.ngsplat', new Response(body(0, 30), { headers: RANGES }))).rejects.toThrow(message);
    }
  });

  it('waits for a server that is just starting', async () => {
    let asked = 0;
    serve((begin) => (++asked === 1 ? new Response(null, { status: 503 }) : rest(begin)));
    expect(await read('a.ngsplat', new Response(body(0, 30), { headers: RANGES }))).toEqual([...FILE]);
    expect(asked).toBe(2);
  });

  it('ends where nothing says that it is the same file, or the server sends no ranges', async () => {
    const asked = serve((begin) => rest(begin));
    await expect(read('a.ply', new Response(body(0, 30), { headers: RANGES }))).rejects.toThrow('network error');
    await expect(read('a.ngsplat', new Response(body(0, 30)))).rejects.toThrow('network error');
    expect(asked).toEqual([]);
  });

  it('ends when it is aborted', async () => {
    const abort = new AbortController();
    const asked = serve(() => {
      abort.abort(new Error('enough'));
      throw new TypeError('no connection');
    });
    await expect(read('a.ngsplat', new Response(body(0, 30), { headers: RANGES }), abort.signal)).rejects.toThrow(
      'enough',
    );
    expect(asked.length).toBe(1);
  });
});
