# SPDX-License-Identifier: Apache-2.0
"""`bag_check`: what is in a bag, is it sound, and save what can be saved."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from grasp_common.command_line import parse
from grasp_common.options import add
from grasp_common.terminal import complain, print_table, progress_bar, say
from grasp_replay.bag_reader import Bag, bag_files, open_bag, read_metadata, storage_kind
from grasp_replay.bag_repair import Examination, examine, recover, strings_of
from grasp_replay.errors import BagError


def build_parser() -> argparse.ArgumentParser:
    """The command line of `bag_check`."""
    parser = argparse.ArgumentParser(
        prog='bag_check',
        description='Tell what is in a bag and if it is sound, reading every byte of it; save '
        'what is sound of a damaged one.',
        epilog='exit code: 0 the bag is sound; 1 it is damaged (also when what could be saved was '
        'saved) or no bag; 2 wrong arguments',
    )
    parser.add_argument('bag', type=Path, help='bag directory, .mcap or .db3 file')
    parser.add_argument(
        '--recover',
        type=Path,
        metavar='BAG',
        help='write every message of a complete, undamaged chunk into this new bag',
    )
    add(parser, '--json')
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `bag_check`; returns the exit code."""
    options = parse('grasp_replay', build_parser(), arguments)
    try:
        report = check(options.bag, options.recover)
    except BagError as error:
        complain('bag_check', error)
        return 1
    if options.json:
        print(json.dumps(report, indent=1))
    else:
        _print(report)
    if not report['sound']:
        complain('bag_check', _verdict(report))
        return 1
    return 0


def check(path: Path, recover_into: Path | None = None) -> dict[str, Any]:
    """The report that `--json` prints; raises BagError when `path` is no bag at all."""
    metadata, notes = read_metadata(path)
    files = bag_files(path, metadata)
    whole = str(metadata.get('compression_mode') or 'none').lower() in ('none', 'message')
    if whole and all(storage_kind(file) == 'mcap' for file in files):
        return _check_mcap(path, files, notes, metadata, recover_into)
    if recover_into is not None:
        raise BagError(f'{path}: only MCAP files can be recovered; use `sqlite3 FILE .recover`')
    with open_bag(path) as bag:
        for _ in bag.messages():
            pass
        return _report(path, bag)


def _check_mcap(
    path: Path,
    files: list[Path],
    notes: list[str],
    metadata: dict[str, Any],
    recover_into: Path | None,
) -> dict[str, Any]:
    total = sum(file.stat().st_size for file in files)
    with progress_bar('reading', total) as show:
        examination = examine(files, show)
    if examination.sound:
        with open_bag(path) as bag:
            report = _report(path, bag)
        _count_again(report, examination)
    else:
        if not any(
            scan.blocks or scan.definitions.channels or scan.attachments or scan.metadata
            for scan in examination.scans
        ):
            reason = examination.lost[0].reason
            raise BagError(f'{path} holds nothing that can be read: {reason}')
        report = _damaged_report(path, examination, notes)
    report['notes'] += _remarks(examination)
    if recover_into is not None:
        with progress_bar('saving', examination.message_count) as show:
            custom = strings_of(metadata.get('custom_data'))
            saved = recover(examination, recover_into, show, custom)
        report['recovered'] = {
            'bag': str(recover_into),
            'messages': saved.messages,
            'attachments': saved.attachments,
            'metadata': saved.metadata,
            'left': list(saved.left),
        }
    return report


def _remarks(examination: Examination) -> list[str]:
    """What is unusual about the files but harmless, or not proven."""
    scans = examination.scans
    notes = []
    unindexed = sum(scan.unindexed_blocks for scan in scans)
    unchecked = sum(scan.unchecked_blocks for scan in scans)
    loose = sum(scan.loose_messages for scan in scans)
    packed = sum(scan.packed_messages for scan in scans)
    if unindexed:
        notes.append(
            f'{unindexed} chunks have no message index, which some players refuse; '
            '--recover writes a bag that has it'
        )
    if unchecked:
        notes.append(f'{unchecked} chunks carry no checksum: content is not proven')
    if loose:
        notes.append(
            f'{loose} messages stand outside the chunks, where some players pass over them; '
            '--recover writes a bag without'
        )
    if packed:
        notes.append(
            f'{packed} messages are compressed one by one; they are unpacked when read, replayed '
            'or saved'
        )
    untyped = sorted({topic for scan in scans for topic in scan.definitions.untyped_topics})
    if untyped:
        notes.append(
            f'the type of {", ".join(untyped)} is not defined in the file: its messages can be '
            'saved, not decoded or replayed'
        )
    return notes


def _count_again(report: dict[str, Any], examination: Examination) -> None:
    """Put the messages that were found in place of those that the index declares, and say so."""
    found = _found_by_topic(examination)
    for topic in report['topics']:
        declared, topic['messages'] = topic['messages'], found.get(topic['name'], 0)
        if declared != topic['messages']:
            report['notes'].append(
                f'the index declares {declared} messages on {topic["name"]}, '
                f'{topic["messages"]} are there'
            )
    report['messages'] = examination.message_count


def _found_by_topic(examination: Examination) -> Counter[str]:
    found: Counter[str] = Counter()
    for scan in examination.scans:
        for channel in scan.definitions.channels.values():
            found[channel.topic] += sum(block.counts.get(channel.id, 0) for block in scan.blocks)
    return found


def _report(path: Path, bag: Bag) -> dict[str, Any]:
    return {
        'bag': str(path),
        'sound': True,
        'storage': bag.storage,
        'files': [file.name for file in bag.files],
        'messages': bag.message_count,
        'start_ns': bag.start,
        'duration_s': bag.duration,
        'topics': [
            {
                'name': topic.name,
                'type': topic.type_name,
                'messages': topic.count,
                'serialization': topic.encoding,
            }
            for topic in sorted(bag.topics.values(), key=lambda topic: topic.name)
        ],
        'lost': [],
        'notes': list(bag.notes),
    }


def _damaged_report(path: Path, examination: Examination, notes: list[str]) -> dict[str, Any]:
    topics: dict[str, dict[str, Any]] = {}
    found = _found_by_topic(examination)
    for scan in examination.scans:
        for channel in scan.definitions.channels.values():
            schema = scan.definitions.schemas.get(channel.schema_id)
            topics.setdefault(
                channel.topic,
                {
                    'name': channel.topic,
                    'type': schema.name if schema else '',
                    'messages': found[channel.topic],
                    'serialization': channel.encoding,
                },
            )
    notes = list(notes)
    if examination.nameless:
        notes.append(
            f'{examination.nameless} sound messages belong to a topic whose definition is lost'
        )
    return {
        'bag': str(path),
        'sound': False,
        'storage': 'mcap',
        'files': [file.name for file in examination.files],
        'messages': examination.message_count,
        'messages_lost': None
        if examination.declared is None
        else examination.declared - examination.message_count,
        'start_ns': examination.start,
        'duration_s': (examination.end - examination.start) * 1e-9,
        'topics': [topics[name] for name in sorted(topics)],
        'lost': [
            {
                'file': span.file,
                'first_byte': span.start,
                'end_byte': span.end,
                'after_ns': span.after,
                'before_ns': span.before,
                'reason': span.reason,
                'text': span.sentence(examination.start),
            }
            for span in examination.lost
        ],
        'notes': notes,
    }


def _verdict(report: dict[str, Any]) -> str:
    spans = '; '.join(span['text'] for span in report['lost'][:3])
    more = len(report['lost']) - 3
    if more > 0:
        spans += f'; and {more} spans more'
    if 'recovered' in report:
        saved = report['recovered']
        outcome = f'{_saved(saved)} into {saved["bag"]}'
    else:
        outcome = (
            f'{report["messages"]} messages can be read, save them with --recover NEW_DIRECTORY'
        )
    return f'{report["bag"]} is damaged ({spans or report["notes"][-1]}); {outcome}'


def _print(report: dict[str, Any]) -> None:
    state = 'sound' if report['sound'] else 'damaged'
    say(
        f'{report["bag"]}: {state}, {report["storage"]}, {len(report["files"])} file(s), '
        f'{report["messages"]} messages in {report["duration_s"]:.3f} s'
    )
    rows = [[topic['name'], topic['type'], str(topic['messages'])] for topic in report['topics']]
    print_table(('topic', 'type', 'messages'), rows)
    for note in report['notes']:
        say(f'note: {note}')
    if 'recovered' in report:
        saved = report['recovered']
        say(f'{_saved(saved)} into {saved["bag"]}')
        for item in saved['left']:
            say(f'left out: {item}')


def _saved(saved: dict[str, Any]) -> str:
    """What was written into a new bag, the kinds that there are none of left out."""
    parts = [
        f'{saved[key]} {word}'
        for key, word in (
            ('messages', 'messages'),
            ('attachments', 'attachments'),
            ('metadata', 'metadata records'),
        )
        if saved[key] or key == 'messages'
    ]
    return f'{" and ".join(parts)} were saved'


if __name__ == '__main__':
    sys.exit(main())
