//! Replacements for the C library's calls that write to a disk: see `disk`.
//!
//! Each function performs the same system call as the library's function. If the calls of this thread are observed,
//! `disk` is asked before the call and informed after it. Other threads of the program, such as those of other tests,
//! are not affected.
#![allow(unsafe_code, reason = "these functions stand in for the C library's, whose interface is pointers")]
#![allow(clippy::missing_safety_doc, reason = "the manual pages of the C library say what its callers owe")]

use super::{clock, disk};
use libc::{c_char, c_int, c_long, c_uint, c_void, clockid_t, off_t, size_t, ssize_t, timespec};
use std::cell::Cell;
use std::ffi::{CStr, OsStr};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::sync::atomic::{AtomicPtr, Ordering};

/// A call that writes.
#[derive(Debug)]
pub enum Call<'c> {
    Open { path: &'c Path, writes: bool, is_new: bool, truncates: bool },
    Close { fd: i32 },
    Write { fd: i32, at: i64, bytes: &'c [u8] },
    Length { fd: i32, length: i64 },
    Flush { fd: i32 },
    Move { from: &'c Path, to: &'c Path },
    Remove { path: &'c Path },
}

thread_local! {
    static LISTENS: Cell<bool> = const { Cell::new(false) };
}

/// Switches the observation of this thread's calls on or off; returns the previous setting.
pub fn set_observed(on: bool) -> bool {
    LISTENS.try_with(|listens| listens.replace(on)).unwrap_or(false)
}

/// Performs the call; `disk` is asked before the call and informed after it.
fn perform(call: &Call<'_>, act: impl FnOnce() -> c_long) -> c_long {
    if !set_observed(false) {
        return act();
    }
    let result = match disk::before(call) {
        Some(error) => {
            // SAFETY: the address of this thread's error number is always valid.
            unsafe { *libc::__errno_location() = error };
            -1
        }
        None => {
            let result = act();
            // SAFETY: as above; informing `disk` must not change the number that the caller reads.
            let error = unsafe { *libc::__errno_location() };
            disk::after(call, result);
            // SAFETY: as above.
            unsafe { *libc::__errno_location() = error };
            result
        }
    };
    set_observed(true);
    result
}

fn path<'c>(text: *const c_char) -> &'c Path {
    // SAFETY: callers of the C library give a text that ends with a zero and lives as long as the call.
    let text = unsafe { CStr::from_ptr(text) };
    Path::new(OsStr::from_bytes(text.to_bytes()))
}

fn perform_open(text: *const c_char, flags: c_int, mode: c_uint) -> c_int {
    let writes = flags & (libc::O_WRONLY | libc::O_RDWR | libc::O_CREAT | libc::O_TRUNC) != 0;
    let path = path(text);
    let is_new = flags & libc::O_CREAT != 0;
    let call = Call::Open { path, writes, is_new, truncates: flags & libc::O_TRUNC != 0 };
    // SAFETY: the arguments are the caller's own.
    perform(&call, || unsafe { libc::syscall(libc::SYS_openat, libc::AT_FDCWD, text, flags, mode) }) as c_int
}

/// Like the C library's function; the mode is read only if a file may be created.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn open(text: *const c_char, flags: c_int, mode: c_uint) -> c_int {
    perform_open(text, flags, mode)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn open64(text: *const c_char, flags: c_int, mode: c_uint) -> c_int {
    perform_open(text, flags, mode)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn close(fd: c_int) -> c_int {
    // SAFETY: the argument is the caller's own.
    perform(&Call::Close { fd }, || unsafe { libc::syscall(libc::SYS_close, fd) }) as c_int
}

fn perform_write(fd: c_int, from: *const c_void, count: size_t, at: Option<off_t>) -> ssize_t {
    let act = || match at {
        // SAFETY: the arguments are the caller's own.
        Some(at) => unsafe { libc::syscall(libc::SYS_pwrite64, fd, from, count, at) },
        // SAFETY: as above.
        None => unsafe { libc::syscall(libc::SYS_write, fd, from, count) },
    };
    if !LISTENS.try_with(Cell::get).unwrap_or(false) {
        return act() as ssize_t;
    }
    // SAFETY: only reads the file's position.
    let at = at.unwrap_or_else(|| unsafe { libc::syscall(libc::SYS_lseek, fd, 0, libc::SEEK_CUR) });
    // SAFETY: the caller gives this number of bytes, which live as long as the call.
    let bytes = unsafe { std::slice::from_raw_parts(from.cast::<u8>(), count) };
    perform(&Call::Write { fd, at, bytes }, act) as ssize_t
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn write(fd: c_int, from: *const c_void, count: size_t) -> ssize_t {
    perform_write(fd, from, count, None)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn pwrite(fd: c_int, from: *const c_void, count: size_t, at: off_t) -> ssize_t {
    perform_write(fd, from, count, Some(at))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn pwrite64(fd: c_int, from: *const c_void, count: size_t, at: off_t) -> ssize_t {
    perform_write(fd, from, count, Some(at))
}

fn set_file_length(fd: c_int, length: off_t) -> c_int {
    // SAFETY: the arguments are the caller's own.
    perform(&Call::Length { fd, length }, || unsafe { libc::syscall(libc::SYS_ftruncate, fd, length) }) as c_int
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn ftruncate(fd: c_int, to: off_t) -> c_int {
    set_file_length(fd, to)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn ftruncate64(fd: c_int, to: off_t) -> c_int {
    set_file_length(fd, to)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fsync(fd: c_int) -> c_int {
    // SAFETY: the argument is the caller's own.
    perform(&Call::Flush { fd }, || unsafe { libc::syscall(libc::SYS_fsync, fd) }) as c_int
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fdatasync(fd: c_int) -> c_int {
    // SAFETY: the argument is the caller's own.
    perform(&Call::Flush { fd }, || unsafe { libc::syscall(libc::SYS_fdatasync, fd) }) as c_int
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn rename(from: *const c_char, to: *const c_char) -> c_int {
    let call = Call::Move { from: path(from), to: path(to) };
    // SAFETY: the arguments are the caller's own.
    let act = || unsafe { libc::syscall(libc::SYS_renameat2, libc::AT_FDCWD, from, libc::AT_FDCWD, to, 0) };
    perform(&call, act) as c_int
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn unlink(text: *const c_char) -> c_int {
    // SAFETY: the arguments are the caller's own.
    let act = || unsafe { libc::syscall(libc::SYS_unlinkat, libc::AT_FDCWD, text, 0) };
    perform(&Call::Remove { path: path(text) }, act) as c_int
}

type ClockGetTime = unsafe extern "C" fn(clockid_t, *mut timespec) -> c_int;

/// Returns the library's own function. It needs no system call, and the time is requested tens of thousands of times in
/// a cycle.
fn library_clock() -> Option<ClockGetTime> {
    static FOUND: AtomicPtr<c_void> = AtomicPtr::new(std::ptr::null_mut());
    let mut found = FOUND.load(Ordering::Relaxed);
    if found.is_null() {
        // SAFETY: the name ends with a zero; every thread finds the same function.
        found = unsafe { libc::dlsym(libc::RTLD_NEXT, c"clock_gettime".as_ptr()) };
        FOUND.store(found, Ordering::Relaxed);
    }
    // SAFETY: the C library's function of this name has this type; a null pointer is `None`.
    unsafe { std::mem::transmute::<*mut c_void, Option<ClockGetTime>>(found) }
}

/// Returns the time. The wall clock of a world has an offset; every other clock is unchanged.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn clock_gettime(which: clockid_t, time: *mut timespec) -> c_int {
    let result = match library_clock() {
        // SAFETY: the arguments are the caller's own.
        Some(read) => unsafe { read(which, time) },
        // SAFETY: as above.
        None => unsafe { libc::syscall(libc::SYS_clock_gettime, which, time) as c_int },
    };
    if which == libc::CLOCK_REALTIME && result == 0 {
        // SAFETY: the system has just written it.
        unsafe { (*time).tv_sec += clock::offset_s() };
    }
    result
}
