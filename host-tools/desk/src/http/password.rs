//! The password of a desk for others.

use argon2::Argon2;
use argon2::password_hash::phc::PasswordHash;
use argon2::password_hash::{PasswordHasher as _, PasswordVerifier as _};
use plumbline_files::BadInput;

/// The fewest letters.
const LETTERS_MIN: usize = 8;

/// The most bytes.
const BYTES_MAX: usize = 256;

/// A password, of which only the hash is kept.
#[derive(Debug, Clone)]
pub struct Password {
    hash: String,
}

impl Password {
    /// Hashes a password (Argon2id).
    ///
    /// # Errors
    /// When it is too short or too long, or the operating system has no random bytes.
    pub fn new(password: &str) -> Result<Self, BadInput> {
        let letters = password.chars().count();
        if letters < LETTERS_MIN || password.len() > BYTES_MAX {
            return Err(BadInput::whole(
                "the password",
                format!("it has {letters} letters"),
                format!("choose one of at least {LETTERS_MIN} letters, for example four words"),
            ));
        }
        let hash = Argon2::default().hash_password(password.as_bytes());
        let hash =
            hash.map_err(|error| BadInput::whole("the password", error, "choose another one"))?;
        Ok(Self { hash: hash.to_string() })
    }

    /// Whether it is this one.
    pub(super) fn is(&self, guess: &str) -> bool {
        guess.len() <= BYTES_MAX
            && PasswordHash::new(&self.hash).is_ok_and(|hash| {
                Argon2::default().verify_password(guess.as_bytes(), &hash).is_ok()
            })
    }
}
