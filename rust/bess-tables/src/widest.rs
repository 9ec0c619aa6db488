//! Inner loops compiled for the widest vectors of the processor.

/// Compiles a function for AVX2 too, and uses that version if the processor supports it. Both versions multiply and add in the same
/// order, so results are bit-identical. `name::portable` is the version without AVX2.
#[macro_export]
macro_rules! widest {
    ($(#[$attribute:meta])* $visible:vis fn $name:ident($($argument:ident: $type:ty),* $(,)?) $body:block) => {
        mod $name {
            #[allow(clippy::wildcard_imports)]
            use super::*;

            #[inline(always)]
            pub(super) fn portable($($argument: $type),*) $body

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            #[allow(unsafe_code)]
            pub(super) unsafe fn avx2($($argument: $type),*) {
                portable($($argument),*);
            }
        }

        $(#[$attribute])*
        #[allow(unsafe_code)]
        $visible fn $name($($argument: $type),*) {
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor supports AVX2.
                unsafe { $name::avx2($($argument),*) };
                return;
            }
            $name::portable($($argument),*);
        }
    };
}
