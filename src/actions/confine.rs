//! Confinement of a child by the operating system: limits on memory and processor time; no files, sockets or processes.

use rustix::process::{Resource, Rlimit, setrlimit};

use super::ActionLimits;

/// Bytes of address space for the program itself, the engine and stacks, beyond what scripts may use.
const OWN_BYTES: u64 = 512 << 20;

/// Confines this process permanently. Open files stay open: standard input and output, and the file that reports
/// memory.
///
/// # Errors
/// Returns an error if the system refuses; no code may be run then.
pub fn confine(limits: &ActionLimits) -> anyhow::Result<()> {
    let seconds = limits.cpu_ms.div_ceil(1_000) + 1;
    let memory = OWN_BYTES + limits.memory_bytes as u64;
    let bounds = [
        (Resource::As, memory, memory),
        // If the engine does not return from a built-in, the system sends SIGXCPU at the first bound, which shows the
        // reason.
        (Resource::Cpu, seconds, seconds + 1),
        (Resource::Fsize, 0, 0),
        (Resource::Core, 0, 0),
        (Resource::Nofile, 3, 3),
    ];
    for (resource, current, maximum) in bounds {
        setrlimit(resource, Rlimit { current: Some(current), maximum: Some(maximum) })?;
    }
    system_calls()
}

/// Allows only the system calls needed to read the job, compute and answer; any other kills the process.
#[cfg(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64")))]
fn system_calls() -> anyhow::Result<()> {
    use seccompiler::{BpfProgram, SeccompAction, SeccompFilter, TargetArch};
    let needed = [
        libc::SYS_read,
        libc::SYS_pread64,
        libc::SYS_write,
        libc::SYS_mmap,
        libc::SYS_munmap,
        libc::SYS_mremap,
        libc::SYS_mprotect,
        libc::SYS_madvise,
        libc::SYS_brk,
        libc::SYS_futex,
        libc::SYS_clock_gettime,
        libc::SYS_getrandom,
        libc::SYS_sched_yield,
        libc::SYS_rt_sigaction,
        libc::SYS_rt_sigprocmask,
        libc::SYS_rt_sigreturn,
        libc::SYS_sigaltstack,
        libc::SYS_getpid,
        libc::SYS_gettid,
        libc::SYS_exit,
        libc::SYS_exit_group,
    ];
    let filter = SeccompFilter::new(
        needed.into_iter().map(|call| (call, Vec::new())).collect(),
        SeccompAction::KillProcess,
        SeccompAction::Allow,
        TargetArch::try_from(std::env::consts::ARCH)?,
    )?;
    let program: BpfProgram = filter.try_into()?;
    seccompiler::apply_filter(&program)?;
    Ok(())
}

/// Does nothing: on other platforms only the resource limits apply.
#[cfg(not(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64"))))]
fn system_calls() -> anyhow::Result<()> {
    Ok(())
}
