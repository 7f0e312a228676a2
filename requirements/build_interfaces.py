# SPDX-License-Identifier: Apache-2.0
"""tf2_msgs and control_msgs for an environment of wheels, which has none: generated and compiled.

On a robot cell both come from apt. Here the few interfaces that the nodes use are generated from
`interfaces/` with the rosidl generators of the environment and compiled into it, where a C++
compiler is; without one the nodes run and say what they do not offer. Run it with the
environment's interpreter.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

INTERFACES = Path(__file__).resolve().parent / 'interfaces'
PACKAGES = ('tf2_msgs', 'control_msgs')
DEPENDENCIES = (
    'action_msgs', 'builtin_interfaces', 'geometry_msgs', 'service_msgs', 'std_msgs',
    'trajectory_msgs', 'unique_identifier_msgs',
)  # fmt: skip
TYPESUPPORTS = ('rosidl_typesupport_fastrtps_c', 'rosidl_typesupport_introspection_c')
PREFIX = Path(sys.prefix)


def main() -> int:
    """Generate and install what is missing; returns the exit code."""
    missing = [package for package in PACKAGES if not (site() / package / '.built').exists()]
    if not missing:
        return 0
    if shutil.which('g++') is None or not (PREFIX / 'share' / 'rosidl_generator_py').exists():
        print(f'No C++ compiler: without {", ".join(missing)} (no TF, no actions)')
        return 0
    for package in missing:
        with tempfile.TemporaryDirectory() as folder:
            try:
                build(package, Path(folder))
            except subprocess.CalledProcessError as error:
                print(error.stdout, file=sys.stderr)
                print(f'{package} does not compile here: no TF, no actions', file=sys.stderr)
                return 0
    return 0


def site() -> Path:
    """Where Python packages of the environment are."""
    return Path(sysconfig.get_path('purelib'))


def build(package: str, work: Path) -> None:
    """Generate and install one package, using `work` for what lies between."""
    arguments, _ = describe(package, work)
    generate(package, arguments, work)
    compile_all(package, work)
    shutil.copytree(work / 'py', site() / package, dirs_exist_ok=True)
    (site() / package / '.built').touch()
    print(f'{package} built')


def describe(package: str, work: Path) -> tuple[dict[str, object], list[Path]]:
    """What the generators are told of a package, and its type descriptions with their hashes."""
    from rosidl_generator_type_description import generate_type_hash

    idls = to_idl(package, work)
    generated = work / 'include' / package
    arguments: dict[str, object] = {
        'package_name': package,
        'idl_tuples': [f'{work}:{package_path}' for package_path in idls],
        'ros_interface_dependencies': [],
        'target_dependencies': [],
        'output_dir': str(generated),
        'include_paths': [f'{name}:{PREFIX / "share" / name}' for name in DEPENDENCIES],
    }
    asked = work / 'types.json'
    asked.write_text(json.dumps(arguments))
    generate_type_hash(str(asked))
    arguments['type_description_tuples'] = [
        f'{path}:{(generated / path).with_suffix(".json")}' for path in idls
    ]
    return arguments, sorted(generated.rglob('*.json'))


def to_idl(package: str, work: Path) -> list[str]:
    """IDL files of a package in `work`, by their paths inside it."""
    from rosidl_adapter.action import convert_action_to_idl
    from rosidl_adapter.msg import convert_msg_to_idl

    paths = []
    # It prints every file that it reads.
    silence = redirect_stdout(StringIO())
    for source in sorted((INTERFACES / package).glob('*/*')):
        convert = convert_action_to_idl if source.suffix == '.action' else convert_msg_to_idl
        inner = source.relative_to(INTERFACES / package)
        folder = work / inner.parent
        folder.mkdir(exist_ok=True)
        with silence:
            convert(INTERFACES / package, package, inner, folder)
        paths.append(str(inner.with_suffix('.idl')))
    return paths


def generate(package: str, arguments: dict[str, object], work: Path) -> None:
    """C structures, type supports and Python classes."""
    from rosidl_generator_c import generate_c
    from rosidl_generator_py import generate_py
    from rosidl_typesupport_c import generate_c as generate_dispatch
    from rosidl_typesupport_fastrtps_c import generate_typesupport_fastrtps_c
    from rosidl_typesupport_introspection_c import generate_c as generate_introspection

    def file(generator: str, output: Path) -> str:
        path = work / f'{generator}.json'
        share = PREFIX / 'share' / generator / 'resource'
        path.write_text(
            json.dumps({**arguments, 'template_dir': str(share), 'output_dir': str(output)})
        )
        output.mkdir(parents=True, exist_ok=True)
        return str(path)

    header = work / 'include' / package
    generate_c(file('rosidl_generator_c', header))
    visibility(package, header, 'rosidl_generator_c')
    for name, run in (
        ('rosidl_typesupport_fastrtps_c', generate_typesupport_fastrtps_c),
        ('rosidl_typesupport_introspection_c', generate_introspection),
    ):
        run(file(name, work / name / package))
        visibility(package, work / name / package, name)
    generate_dispatch(
        file('rosidl_typesupport_c', work / 'rosidl_typesupport_c' / package), list(TYPESUPPORTS)
    )
    generate_py(file('rosidl_generator_py', work / 'py'), ['rosidl_typesupport_c'])
    (work / 'py' / '__init__.py').touch()


def visibility(package: str, output: Path, generator: str) -> None:
    """The header of export macros, which CMake writes elsewhere."""
    name = f'{generator}__visibility_control.h'
    template = (PREFIX / 'share' / generator / 'resource' / f'{name}.in').read_text()
    filled = template.replace('@PROJECT_NAME@', package)
    (output / 'msg').mkdir(parents=True, exist_ok=True)
    (output / 'msg' / name).write_text(filled.replace('@PROJECT_NAME_UPPER@', package.upper()))


def compile_all(package: str, work: Path) -> None:
    """Five libraries of the package, and the Python module that loads them."""
    import numpy

    includes = [work / 'include', *(work / name for name in TYPESUPPORTS)]
    includes += [PREFIX / 'include', *(PREFIX / 'include').glob('*/')]
    includes += [Path(sysconfig.get_path('include')), Path(numpy.get_include())]
    flags = [f'-I{path}' for path in includes]
    python = sorted((work / 'py').glob('*/*_s.c'))
    entry = next((work / 'py').glob('*.ep.rosidl_typesupport_c.c'))
    # What each library links to besides the one before it.
    parts = [
        ('rosidl_generator_c', sorted((work / 'include').rglob('*.c')), []),
        *((name, sources(work / name), ['rosidl_generator_c']) for name in TYPESUPPORTS),
        ('rosidl_typesupport_c', sources(work / 'rosidl_typesupport_c'), ['rosidl_generator_c']),
        ('rosidl_generator_py', python, ['rosidl_generator_c']),
    ]
    for name, files, links in parts:
        library = PREFIX / 'lib' / f'lib{package}__{name}.so'
        link(objects(files, flags, work / f'{name}_objects'), library, package, links)
    suffix = sysconfig.get_config_var('EXT_SUFFIX')
    module = work / 'py' / f'{package}_s__rosidl_typesupport_c{suffix}'
    everything = ['rosidl_generator_c', 'rosidl_generator_py', 'rosidl_typesupport_c']
    link(objects([entry], flags, work / 'entry_objects'), module, package, everything)


def sources(folder: Path) -> list[Path]:
    """C and C++ files of a generator."""
    return sorted([*folder.rglob('*.c'), *folder.rglob('*.cpp')])


def objects(files: list[Path], flags: list[str], folder: Path) -> list[Path]:
    """Compile each file, two at a time."""
    folder.mkdir()

    def one(numbered: tuple[int, Path]) -> Path:
        number, file = numbered
        target = folder / f'{number}.o'
        run(['g++' if file.suffix == '.cpp' else 'gcc', '-O1', '-fPIC', '-w', '-c', str(file)]
            + ['-o', str(target), *flags])  # fmt: skip
        return target

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(one, enumerate(files)))


def link(parts: list[Path], target: Path, package: str, links: list[str]) -> None:
    """Link objects with libraries of this package, those of ROS, and those of its dependencies."""
    libraries = PREFIX / 'lib'
    wanted = [f'{package}__{name}' for name in links]
    for name in DEPENDENCIES:
        wanted += [f'{name}__{kind}' for kind in ('rosidl_generator_c', *TYPESUPPORTS)]
        wanted += [f'{name}__rosidl_typesupport_c', f'{name}__rosidl_generator_py']
    wanted += [
        'rosidl_runtime_c', 'rosidl_typesupport_c', 'rosidl_typesupport_fastrtps_c',
        'rosidl_typesupport_fastrtps_cpp', 'rosidl_typesupport_introspection_c', 'rmw', 'rcutils',
        'fastcdr',
    ]  # fmt: skip
    found = [f'-l{name}' for name in wanted if (libraries / f'lib{name}.so').exists()]
    run(['g++', '-shared', '-o', str(target), *map(str, parts), f'-L{libraries}', *found]
        + [f'-Wl,-rpath,{libraries}', '-Wl,--as-needed'])  # fmt: skip


def run(command: list[str]) -> None:
    """Run a compiler; raises CalledProcessError with what it said."""
    subprocess.run(
        command, check=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


if __name__ == '__main__':
    sys.exit(main())
