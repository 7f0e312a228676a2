# SPDX-License-Identifier: Apache-2.0
"""Object files that expand or nest beyond reason are one sentence, at once."""

import pytest

from grasp_common.bounded_yaml import DEEPEST
from shell_deform.objects import ObjectError, load_object

LAUGHS = 'a: &a [lol, lol, lol, lol, lol, lol, lol, lol, lol]\n' + ''.join(
    f'{chr(97 + i)}: &{chr(97 + i)} [{",".join(["*" + chr(96 + i)] * 9)}]\n' for i in range(1, 9)
)


@pytest.mark.parametrize(
    ('text', 'told'),
    [(LAUGHS, 'more than 50000 values'), ('[' * 20_000, f'than {DEEPEST} levels')],
)
def test_a_bomb_is_refused_by_what_it_is(tmp_path, text, told):
    file = tmp_path / 'object.yaml'
    file.write_text(text)
    with pytest.raises(ObjectError, match=told):
        load_object(str(file))
