//! Inner loops compiled for the widest vectors of the processor.

/// A function that is also compiled for AVX2 and runs so where the processor has it. It multiplies and adds in the same order, so that
/// results are the same to the bit. What runs elsewhere is `name::portable`.
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
                // SAFETY: the processor has been asked for AVX2.
                unsafe { $name::avx2($($argument),*) };
                return;
            }
            $name::portable($($argument),*);
        }
    };
}
