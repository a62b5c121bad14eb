"""What machine this is, out of the texts that x86 and Arm kernels give."""

from __future__ import annotations

from dataclasses import replace

from anytraverse.bundle.machine import Machine, read_cpuinfo, this_machine

XEON = """\
processor\t: 0
vendor_id\t: GenuineIntel
model name\t: Intel(R) Xeon(R)  Platinum 8488C
flags\t\t: fpu sse2 avx avx2 avx512f avx512_vnni avx_vnni amx_bf16 amx_int8
bogomips\t: 4800.00

processor\t: 1
vendor_id\t: GenuineIntel
model name\t: Intel(R) Xeon(R)  Platinum 8488C
flags\t\t: fpu sse2 avx avx2 avx512f avx512_vnni avx_vnni amx_bf16 amx_int8

"""
PI_5 = """\
processor\t: 0
BogoMIPS\t: 108.00
Features\t: fp asimd evtstrm aes crc32 atomics fphp asimdhp cpuid asimdrdm lrcpc dcpop asimddp
CPU implementer\t: 0x41
CPU architecture: 8
CPU variant\t: 0x4
CPU part\t: 0xd0b
CPU revision\t: 1

Revision\t: d04170
Model\t\t: Raspberry Pi 5 Model B Rev 1.0
"""
BIG_LITTLE = """\
processor\t: 0
Features\t: fp asimd asimddp
CPU implementer\t: 0x41
CPU part\t: 0xd05

processor\t: 1
Features\t: fp asimd asimddp i8mm
CPU implementer\t: 0x41
CPU part\t: 0xd0b
"""
CARMEL = """\
processor\t: 0
model name\t: ARMv8 Processor rev 0 (v8l)
Features\t: fp asimd
CPU implementer\t: 0x4e
CPU part\t: 0x004
"""


def test_an_x86_is_told_by_its_name_and_the_flags_that_matter() -> None:
    cpu, flags = read_cpuinfo(XEON)
    assert cpu == "Intel(R) Xeon(R) Platinum 8488C"
    assert flags == ("amx_bf16", "amx_int8", "avx2", "avx512_vnni", "avx512f", "avx_vnni")


def test_an_arm_board_is_told_by_its_model_and_its_cores() -> None:
    cpu, flags = read_cpuinfo(PI_5)
    assert cpu == "Raspberry Pi 5 Model B Rev 1.0 Cortex-A76"
    assert flags == ("asimd", "asimddp", "asimdhp")


def test_of_cores_that_differ_only_shared_flags_count() -> None:
    assert read_cpuinfo(BIG_LITTLE) == ("Cortex-A55+Cortex-A76", ("asimd", "asimddp"))


def test_cores_of_other_makers_are_told_by_their_numbers() -> None:
    assert read_cpuinfo(CARMEL) == ("Arm 0x4e 0x004", ("asimd",))


def test_a_text_without_processors_tells_nothing() -> None:
    assert read_cpuinfo("") == ("", ())
    assert read_cpuinfo("no colon\n\n: \nCPU part:") == ("", ())


def test_the_id_names_a_file_and_tells_machines_apart() -> None:
    machine = Machine("Intel(R) Xeon(R) Platinum 8488C", "x86_64", ("avx2",), 2, "1.31.0")
    assert machine.id.startswith("intel-r-xeon-r-platinum-8488c-")
    assert machine.id == replace(machine, onnxruntime="1.32.0").id
    others = {replace(machine, flags=()).id, replace(machine, cores=4).id, replace(machine, cpu="Xeon").id}
    assert len(others | {machine.id}) == 4
    assert "/" not in replace(machine, cpu="../../x").id


def test_this_machine_is_the_same_twice() -> None:
    machine = this_machine()
    assert machine == this_machine()
    assert machine.cores >= 1
    assert machine.cpu
