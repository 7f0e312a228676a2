// SPDX-License-Identifier: Apache-2.0
// Overlays of the page, and its theme: the browser's, unless the visitor chose another.
(() => {
  'use strict';
  const PERIOD_MS = 250, LOST_AFTER = 8, HEADER_PX = 44;
  const wanted = matchMedia('(prefers-color-scheme: dark)');
  const chosen = () => { try { return localStorage.getItem('grasp-theme'); } catch { return null; } };
  const isDark = () => (chosen() || (wanted.matches ? 'dark' : 'light')) === 'dark';
  // Read by the server when the library connects; it themes the library's own parts.
  // By the name of this tab the server knows whose camera a scale bar is of.
  const tab = Array.from(crypto.getRandomValues(new Uint32Array(3)), n => n.toString(36)).join('');
  const tell = () => {
    document.cookie = `grasp_tab=${tab}; path=/; SameSite=Strict`;
    const size = `${innerWidth}x${Math.max(innerHeight - HEADER_PX, 10)}`;
    document.cookie = `grasp_window=${size}; path=/; SameSite=Strict`;
    document.cookie = `grasp_theme=${isDark() ? 'dark' : 'light'}; path=/; SameSite=Strict`;
    document.documentElement.classList.toggle('grasp-dark', isDark());
  };
  tell();
  const follow = () => { const before = document.documentElement.classList.contains('grasp-dark');
    if (before !== isDark()) { tell(); location.reload(); } };
  wanted.addEventListener('change', follow);

  addEventListener('DOMContentLoaded', () => {
    document.documentElement.lang = 'en';
    const overlay = document.createElement('div');
    overlay.id = 'grasp-overlay';
    const part = (name, tag) => {
      const element = document.createElement(tag || 'div');
      element.id = `grasp-${name}`;
      overlay.append(element);
      return element;
    };
    const parts = { header: part('header', 'header'), legend: part('legend'), chip: part('chip'),
      probe: part('probe'), scale: part('scale') };
    const theme = document.createElement('button');
    theme.id = 'grasp-theme';
    theme.type = 'button';
    theme.textContent = isDark() ? 'Light' : 'Dark';
    theme.title = 'Show the page on a light or on a dark ground';
    theme.addEventListener('click', () => {
      try { localStorage.setItem('grasp-theme', isDark() ? 'light' : 'dark'); } catch { /* ask again */ }
      follow();
    });
    overlay.append(theme);
    document.body.append(overlay);
    // The library gives sliders and their number boxes no names; the words beside them are.
    const name = () => {
      for (const e of document.querySelectorAll('[role=slider], input, button')) {
        if (e.type === 'hidden' || (e.innerText || '').trim() || e.getAttribute('aria-label') || e.title
          || (e.labels && e.labels.length)) continue;
        if (e.tagName === 'BUTTON') {
          const notice = e.closest('.mantine-Notifications-root');
          e.setAttribute('aria-label', notice ? 'Close the notice' : 'Connection and layout');
          continue;
        }
        let row = e.parentElement;
        while (row && !/[a-z]/i.test(row.textContent)) row = row.parentElement;
        const words = row && document.createTreeWalker(row, NodeFilter.SHOW_TEXT).nextNode();
        if (words) e.setAttribute('aria-label', words.textContent.trim());
      }
    };
    setInterval(name, 1000);
    let missed = 0;
    const ask = async () => {
      try {
        // The scene's is the highest, the plots have their own.
        const heights = [...document.querySelectorAll('#root canvas')].map(e => e.clientHeight);
        const asked = `overlay?tab=${tab}&width=${innerWidth}&height=${Math.max(0, ...heights)}`;
        const answer = await (await fetch(asked, { cache: 'no-store' })).json();
        missed = 0;
        for (const [name, element] of Object.entries(parts)) {
          const now = answer[name] || '';
          if (element.dataset.now !== now) { element.dataset.now = now; element.innerHTML = now; }
          element.hidden = !now;
        }
        if (answer.title && document.title !== answer.title) document.title = answer.title;
      } catch {
        missed += 1;
        tell();
      }
      overlay.classList.toggle('lost', missed >= LOST_AFTER);
      setTimeout(ask, PERIOD_MS);
    };
    ask();
  });
})();
