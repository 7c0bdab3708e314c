//! Catches panics of executions, and keeps them off the terminal.

use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    static QUIET: Cell<bool> = const { Cell::new(false) };
    static PANIC_TEXT: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Calls a function that may panic; the error has place and cause of the panic.
///
/// Panics of other threads print as usual.
pub(super) fn caught<T>(execute: impl FnOnce() -> T) -> Result<T, String> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = take_hook();
        set_hook(Box::new(move |info| {
            if QUIET.get() {
                PANIC_TEXT.set(info.to_string());
            } else {
                before(info);
            }
        }));
    });
    QUIET.set(true);
    // A panic leaves only this execution's own data half-done.
    let result = catch_unwind(AssertUnwindSafe(execute));
    QUIET.set(false);
    result.map_err(|_| PANIC_TEXT.take())
}
