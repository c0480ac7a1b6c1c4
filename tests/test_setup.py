# SPDX-License-Identifier: Apache-2.0
"""What a machine lacks is said in one line, and env.bash can be sourced anywhere."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from uv_settings import variables

pytestmark = pytest.mark.system

ROOT = Path(__file__).resolve().parent.parent
PREFLIGHT = ROOT / 'tools' / 'preflight.sh'
BARE_COMMANDS = ('bash', 'uname', 'getconf', 'env', 'make')


@pytest.fixture
def commands(tmp_path: Path) -> Path:
    """A folder with the commands of a machine that has all it takes, to take away from."""
    folder = tmp_path / 'bin'
    folder.mkdir()
    for name in BARE_COMMANDS:
        (folder / name).symlink_to(shutil.which(name))
    base_python = Path(sys.base_prefix, 'bin', f'python3.{sys.version_info[1]}')
    script(folder / 'python3', f'exec {base_python} "$@"')
    # The compiler looks for its parts beside itself and on the path, so it is called with its own.
    compiler = shutil.which('c++')
    script(folder / 'c++', f'PATH={Path(compiler).parent} exec {compiler} "$@"')
    return folder


def script(path: Path, line: str) -> None:
    path.unlink(missing_ok=True)
    path.write_text(f'#!/bin/bash\n{line}\n')
    path.chmod(0o755)


def preflight(commands: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {'PATH': str(commands), **variables}
    return subprocess.run(
        [shutil.which('bash'), PREFLIGHT],
        env=environment,
        capture_output=True,
        text=True,
        timeout=30,
    )


def only_line(result: subprocess.CompletedProcess[str]) -> str:
    assert result.returncode == 1
    assert result.stdout == ''
    assert result.stderr.startswith('preflight: ')
    assert result.stderr.count('\n') == 1
    return result.stderr


def test_preflight_names_the_interpreter_of_a_machine_that_has_all(commands: Path) -> None:
    result = preflight(commands)
    assert (result.returncode, result.stderr) == (0, '')
    assert result.stdout == f'{commands}/python3\n'


def test_a_missing_compiler_is_one_line(commands: Path) -> None:
    (commands / 'c++').unlink()
    assert 'no C++ compiler' in only_line(preflight(commands))


def test_a_missing_make_is_one_line(commands: Path) -> None:
    (commands / 'make').unlink()
    assert 'no make' in only_line(preflight(commands))


def test_a_compiler_that_does_not_work_is_one_line(commands: Path) -> None:
    script(commands / 'c++', 'exit 1')
    assert 'cannot compile' in only_line(preflight(commands))


def test_missing_python_headers_are_one_line(commands: Path) -> None:
    compiler = shutil.which('c++')
    script(
        commands / 'c++', f'PATH={Path(compiler).parent} exec {compiler} "${{@/#\\/*/\\/nowhere}}"'
    )
    assert 'no Python.h' in only_line(preflight(commands))


@pytest.mark.parametrize('found', ['cpython 3.9', 'cpython 3.14', 'pypy 3.10'])
def test_an_unsuited_python_is_one_line(commands: Path, found: str) -> None:
    script(commands / 'python3', f'echo {found}')
    line = only_line(preflight(commands))
    assert 'CPython 3.10 to 3.13 is needed' in line
    assert f'/python3 is {found}' in line


def test_a_python_that_only_fails_is_passed_over(commands: Path) -> None:
    (commands / 'python3').rename(commands / 'python3.12')
    script(commands / 'python3', 'echo "python3: command not found" >&2; exit 127')
    result = preflight(commands)
    assert result.returncode == 0
    assert result.stdout == f'{commands}/python3.12\n'


def test_a_complete_python_is_preferred(commands: Path) -> None:
    base_python = Path(sys.base_prefix, 'bin', f'python3.{sys.version_info[1]}')
    (commands / 'python3').rename(commands / 'python3.12')
    script(
        commands / 'python3', f'case "$2" in *ensurepip*) exit 1 ;; esac; exec {base_python} "$@"'
    )
    assert preflight(commands).stdout == f'{commands}/python3.12\n'


def test_the_python_asked_for_by_name_is_the_only_one_tried(commands: Path) -> None:
    script(commands / 'other', 'echo cpython 3.8')
    assert '/other is cpython 3.8' in only_line(preflight(commands, PYTHON='other'))


def test_a_python_without_venv_is_one_line(commands: Path) -> None:
    base_python = Path(sys.base_prefix, 'bin', f'python3.{sys.version_info[1]}')
    script(
        commands / 'python3', f'case "$2" in *ensurepip*) exit 1 ;; esac; exec {base_python} "$@"'
    )
    assert 'python3-venv' in only_line(preflight(commands))


@pytest.mark.parametrize(('system', 'machine'), [('Linux', 'aarch64'), ('Darwin', 'x86_64')])
def test_another_platform_is_one_line(commands: Path, system: str, machine: str) -> None:
    script(commands / 'uname', f'[ "$1" = -s ] && echo {system} || echo {machine}')
    assert f'this is {system} {machine}' in only_line(preflight(commands))


@pytest.mark.parametrize('answer', ['echo glibc 2.27', 'exit 1'])
def test_an_old_or_other_c_library_is_one_line(commands: Path, answer: str) -> None:
    script(commands / 'getconf', answer)
    assert 'glibc 2.28 or newer' in only_line(preflight(commands))


def test_nothing_is_made_or_downloaded_where_something_is_missing(
    commands: Path, tmp_path: Path
) -> None:
    clone = tmp_path / 'clone'
    (clone / 'tools').mkdir(parents=True)
    for name in ('Makefile', 'requirements.txt', 'tools/setup.sh', 'tools/preflight.sh'):
        shutil.copy(ROOT / name, clone / name)
    (commands / 'c++').unlink()
    for name in ('dirname', 'cat'):
        (commands / name).symlink_to(shutil.which(name))
    result = subprocess.run(
        [shutil.which('make')],
        cwd=clone,
        env={'PATH': str(commands)},
        capture_output=True,
        text=True,
        timeout=30,
    )
    assert result.returncode != 0
    assert 'preflight: no C++ compiler' in result.stderr
    assert not (clone / '.venv').exists()


def test_what_pip_is_configured_to_holds_for_uv_and_its_environment_comes_first() -> None:
    lines = [
        ":env:.index-url='https://wheels.example/simple'",
        ":env:.disable-pip-version-check='1'",
        "global.index-url='https://other.example/simple'",
        "global.find-links='/srv/a\\n/srv/b'",
        "site.no-index='true'",
    ]
    assert variables(lines) == {
        'UV_DEFAULT_INDEX': 'https://wheels.example/simple',
        'UV_FIND_LINKS': '/srv/a,/srv/b',
        'UV_OFFLINE': 'true',
    }


def clock(command: str) -> subprocess.CompletedProcess[str]:
    """Run a command as set-up does that is silent while it works."""
    text = (ROOT / 'tools' / 'setup.sh').read_text()
    function = text.partition('with_time() {')[2].partition('\n}\n')[0]
    script = f'with_time() {{{function.replace("sleep 10", "sleep 0.1")}\n}}\n{command}'
    return subprocess.run(['bash', '-c', script], capture_output=True, text=True, timeout=30)


def test_what_is_silent_while_it_works_is_told_of_and_keeps_its_exit_code() -> None:
    result = clock('with_time wheels bash -c "sleep 1; exit 7"')
    assert result.returncode == 7
    assert result.stdout.startswith('set-up:   wheels, ')
    assert clock('with_time wheels true').returncode == 0


def sourced(command: str, cwd: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {'PATH': '/usr/local/bin:/usr/bin:/bin', 'HOME': str(cwd), **variables}
    return subprocess.run(
        [shutil.which('bash'), '-c', command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )


ENV = f'source {ROOT}/env.bash'


def test_env_works_from_any_folder_and_in_a_strict_shell(tmp_path: Path) -> None:
    result = sourced(
        f'set -eu; {ENV}; echo $-; python -c "import rclpy, calib_interfaces.msg"; command -v ros2',
        tmp_path,
    )
    assert (result.returncode, result.stderr) == (0, '')
    flags, _ros2 = result.stdout.split()
    assert {'e', 'u'} <= set(flags)


def test_env_leaves_a_lax_shell_lax(tmp_path: Path) -> None:
    assert sourced(f'{ENV}; echo "$-"; false; echo $undefined on', tmp_path).stdout.endswith('on\n')


def test_env_sourced_twice_changes_nothing_more(tmp_path: Path) -> None:
    result = sourced(f'{ENV}; env | sort >one; {ENV}; env | sort >two; diff one two', tmp_path)
    assert (result.returncode, result.stdout) == (0, '')


def test_env_leaves_no_names_of_its_own(tmp_path: Path) -> None:
    assert sourced(f'{ENV}; set | grep ^_calib', tmp_path).stdout == ''


def test_env_keeps_what_the_user_has_chosen(tmp_path: Path) -> None:
    result = sourced(
        f'{ENV}; echo $ROS_AUTOMATIC_DISCOVERY_RANGE $RMW_IMPLEMENTATION',
        tmp_path,
        ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET',
        RMW_IMPLEMENTATION='rmw_other',
    )
    assert result.stdout == 'SUBNET rmw_other\n'
    assert sourced(f'{ENV}; echo $ROS_AUTOMATIC_DISCOVERY_RANGE', tmp_path).stdout == 'LOCALHOST\n'


def test_the_stand_in_stays_off_the_path_of_a_machine_with_ros2(tmp_path: Path) -> None:
    script(tmp_path / 'ros2', 'echo the real one')
    path = f'{tmp_path}:/usr/local/bin:/usr/bin:/bin'
    assert sourced(f'{ENV}; ros2', tmp_path, PATH=path).stdout == 'the real one\n'
    assert 'tools/ros2' not in sourced(f'{ENV}; echo $PATH', tmp_path, PATH=path).stdout


def test_env_says_that_make_has_not_run(tmp_path: Path) -> None:
    shutil.copy(ROOT / 'env.bash', tmp_path)
    result = sourced(f'source {tmp_path}/env.bash; echo $?', tmp_path)
    assert result.stderr == f"env.bash: nothing is built yet, run 'make' in {tmp_path} first\n"
    assert result.stdout == '1\n'
