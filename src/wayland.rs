//! Keeps libwayland quiet where there is no Wayland session.
//!
//! Mesa's Vulkan layer for the choice of a device asks the Wayland compositor which one it uses, whenever adapters are listed. Without
//! `XDG_RUNTIME_DIR`, as on servers and in containers, libwayland cannot find a socket and prints `error: XDG_RUNTIME_DIR is invalid or not
//! set in the environment.` to stderr, each time. Turning the layer off would also turn off the variables by which users choose a device
//! (`MESA_VK_DEVICE_SELECT`, `DRI_PRIME`).

use std::ffi::OsString;
use std::path::Path;

/// The number of a connected socket, which a parent process may hand down.
const SOCKET: &str = "WAYLAND_SOCKET";

/// Call this before the process has other threads. Where libwayland could not connect, and nobody asked it to, it is told so: it gives up
/// without a word if the socket is empty, which everything else takes for one that is not set.
pub fn settle() {
    if is_without_session(&|name| std::env::var_os(name)) {
        #[expect(unsafe_code, reason = "there is no safe way to set a variable of the own process")]
        // SAFETY: no other thread runs yet that could read the environment meanwhile.
        unsafe {
            std::env::set_var(SOCKET, "");
        }
    }
}

/// Whether no display and no socket is named, and no folder in which the default one could be.
fn is_without_session(variable: &dyn Fn(&str) -> Option<OsString>) -> bool {
    let is_unset = |name| variable(name).is_none_or(|value| value.is_empty());
    let has_folder = variable("XDG_RUNTIME_DIR").is_some_and(|folder| Path::new(&folder).is_absolute());
    variable(SOCKET).is_none() && is_unset("WAYLAND_DISPLAY") && !has_folder
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sessions_are_left_alone() {
        let is_without = |variables: &[(&str, &str)]| {
            let value = |name: &str| variables.iter().find(|(of, _)| *of == name).map(|(_, value)| value.into());
            is_without_session(&value)
        };
        assert!(is_without(&[]));
        assert!(is_without(&[("DISPLAY", ":0"), ("WAYLAND_DISPLAY", "")]));
        assert!(is_without(&[("XDG_RUNTIME_DIR", "")]), "libwayland wants an absolute path");
        assert!(!is_without(&[("XDG_RUNTIME_DIR", "/run/user/1000")]), "the default display may be there");
        assert!(!is_without(&[("WAYLAND_DISPLAY", "/run/wayland-1")]));
        assert!(
            !is_without(&[("WAYLAND_DISPLAY", "wayland-1")]),
            "it was asked for, and libwayland says what is missing"
        );
        assert!(!is_without(&[("WAYLAND_SOCKET", "3")]));
    }
}
