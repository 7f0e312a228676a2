# SPDX-License-Identifier: Apache-2.0
"""What a visitor needs of any page of ours: text that stands out, controls that have names.

`TEXTS` and `NAMELESS` are evaluated in a browser's tab.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

# Text that is visible, its colour, and the colours behind it until one is opaque.
TEXTS = """() => {
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = walker.nextNode());) {
    const text = node.textContent.trim();
    const element = node.parentElement;
    if (!text || !element || ['SCRIPT', 'STYLE'].includes(element.tagName)) continue;
    const box = element.getBoundingClientRect();
    const style = getComputedStyle(element);
    if (!box.width || !box.height || style.visibility === 'hidden') continue;
    if (element.closest('canvas, .mantine-Notifications-root, [aria-hidden=true]')) continue;
    const svg = element.namespaceURI.endsWith('svg');
    const behind = [];
    let opacity = 1;
    for (let e = element; e; e = e.parentElement) {
      const s = getComputedStyle(e);
      opacity *= Number(s.opacity);
      behind.push(s.backgroundColor);
    }
    found.push({text: text.slice(0, 40), colour: svg ? style.fill : style.color, behind, opacity,
                size: parseFloat(style.fontSize)});
  }
  return found;
}"""
NAMELESS = """() => [...document.querySelectorAll(
    'input, select, button, [role=slider], [role=img]')]
  .filter(e => e.getBoundingClientRect().width && e.type !== 'hidden')
  .filter(e => !(e.innerText || '').trim() && !e.getAttribute('aria-label') && !e.title
    && !(e.labels && e.labels.length) && !e.closest('label')
    && !document.querySelector(`label[for="${CSS.escape(e.id || '-')}"]`))
  .map(e => e.outerHTML.slice(0, 160))"""


def luminance(colour: Sequence[float]) -> float:
    """W3C's relative luminance of an sRGB colour of 255."""
    value = np.asarray(colour, dtype=float)[:3] / 255.0
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(first: Sequence[float], second: Sequence[float]) -> float:
    """W3C's contrast ratio of two sRGB colours."""
    low, high = sorted([luminance(first), luminance(second)])
    return (high + 0.05) / (low + 0.05)


def channels(text: str) -> np.ndarray:
    """Red, green, blue of 255 and the opacity of a computed colour."""
    numbers = [float(part) for part in text[text.index('(') + 1 : -1].split(',')]
    return np.array([*numbers, 1.0][:4])


def worst_contrast(texts: list[dict[str, Any]], ground: Sequence[int]) -> list[tuple[float, str]]:
    """Ratio and text of all that `TEXTS` found, the lowest first; `ground` lies below all."""
    found = []
    for text in texts:
        behind = np.array(ground, dtype=float)
        for layer in reversed(text['behind']):
            colour = channels(layer)
            behind = (1 - colour[3]) * behind + colour[3] * colour[:3]
        colour = channels(text['colour'])
        share = colour[3] * text['opacity']
        shown = (1 - share) * behind + share * colour[:3]
        found.append((contrast(shown, behind), text['text']))
    return sorted(found)
