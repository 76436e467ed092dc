//! The terminal as a screen: a picture above, lines of text below, keys.
//!
//! The picture is a sixel where the terminal supports it, otherwise half blocks. `icy_sixel`
//! encodes sixels, as it does for `ratatui-image`; half blocks are a few lines with `crossterm`.
//! `ratatui` would bring its own screen buffer and layout for a picture and a few lines of text.

use std::io::{self, Stdout, Write};
use std::time::Duration;

use clap::ValueEnum;
use crossterm::cursor::{Hide, MoveTo, Show};
use crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use crossterm::style::{
    Attribute, Color, Print, ResetColor, SetAttribute, SetForegroundColor, available_color_count,
};
use crossterm::terminal::{
    self, BeginSynchronizedUpdate, Clear, ClearType, EndSynchronizedUpdate, EnterAlternateScreen,
    LeaveAlternateScreen,
};
use crossterm::{execute, queue};
use icy_sixel::{EncodeOptions, SixelImage};
use image::RgbImage;
use image::imageops::{FilterType, resize};

use super::ability;
use super::blocks::{self, Colours};

/// How pictures are shown in a terminal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Graphics {
    /// As sixels where the terminal supports them, otherwise as half blocks.
    Auto,
    /// As sixels.
    Sixel,
    /// As half blocks in colours.
    Blocks,
    /// Not at all: numbers only.
    None,
}

/// A cell's width and height where the terminal does not say: smaller than most, so that the
/// picture does not reach into the text.
const CELL_PX: [u16; 2] = [8, 16];

/// Fewer colours cannot show a picture.
const COLOURS_MIN: u16 = 256;

/// A sixel is enlarged by no more than this: beyond, it only takes longer.
const ENLARGED_MAX: f64 = 2.0;

/// What the user wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// The end.
    Quit,
    /// A still.
    Still,
}

/// A line of text.
pub struct Line {
    /// The text; what is wider than the terminal is cut.
    pub text: String,
    /// How it looks.
    pub look: Look,
}

/// How a line looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// As usual.
    Plain,
    /// As what matters.
    Bold,
    /// As what is to be done.
    Advice,
}

/// How this terminal shows pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shown {
    Sixel { cell_px: [u16; 2] },
    Blocks(Colours),
    Nothing,
}

/// A terminal in use; it is restored when this is dropped.
pub struct Screen {
    out: Stdout,
    shown: Shown,
    /// Everything is to be redrawn.
    is_stale: bool,
    /// Rows that the picture took.
    picture_rows: u16,
}

impl Screen {
    /// Takes the terminal.
    ///
    /// # Errors
    /// When it cannot be set up.
    pub fn open(graphics: Graphics) -> io::Result<Self> {
        terminal::enable_raw_mode()?;
        // From here on the terminal is restored, whatever happens.
        let shown = Shown::Nothing;
        let mut screen = Self { out: io::stdout(), shown, is_stale: true, picture_rows: 0 };
        screen.shown = match graphics {
            Graphics::None => Shown::Nothing,
            Graphics::Blocks => Shown::Blocks(colours()),
            Graphics::Auto | Graphics::Sixel => {
                let ability = ability::ask(&mut screen.out)?;
                if ability.sixel || graphics == Graphics::Sixel {
                    Shown::Sixel { cell_px: ability.cell_px.unwrap_or(cell_px()) }
                } else if available_color_count() >= COLOURS_MIN {
                    Shown::Blocks(colours())
                } else {
                    Shown::Nothing
                }
            }
        };
        execute!(screen.out, EnterAlternateScreen, Hide)?;
        Ok(screen)
    }

    /// Whether it shows pictures.
    pub fn has_pictures(&self) -> bool {
        self.shown != Shown::Nothing
    }

    /// The size, in pixels, at which a picture of this size is shown above this many lines;
    /// `None` where it is not shown.
    ///
    /// # Errors
    /// When the terminal does not report its size.
    pub fn picture_px(&self, size_px: [u32; 2], lines: usize) -> io::Result<Option<[u32; 2]>> {
        let (columns, rows) = terminal::size()?;
        let rows = rows.saturating_sub(lines as u16);
        let (room_px, enlarged_max) = match self.shown {
            Shown::Nothing => return Ok(None),
            Shown::Sixel { cell_px: [width, height] } => {
                let room =
                    [u32::from(columns) * u32::from(width), u32::from(rows) * u32::from(height)];
                (room, ENLARGED_MAX)
            }
            Shown::Blocks(_) => ([u32::from(columns), 2 * u32::from(rows)], 1.0),
        };
        let scale = |axis: usize| f64::from(room_px[axis]) / f64::from(size_px[axis]);
        let scale = scale(0).min(scale(1)).min(enlarged_max);
        let size_px = size_px.map(|side| (f64::from(side) * scale) as u32);
        Ok((size_px[0] > 0 && size_px[1] > 0).then_some(size_px))
    }

    /// Columns of text.
    ///
    /// # Errors
    /// When the terminal does not report its size.
    pub fn columns(&self) -> io::Result<usize> {
        Ok(terminal::size()?.0.into())
    }

    /// Shows a picture, which has the size that [`picture_px`](Self::picture_px) gave.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn show_picture(&mut self, picture: &RgbImage) -> io::Result<()> {
        let rows = match self.shown {
            Shown::Nothing => return Ok(()),
            Shown::Sixel { cell_px: [_, height] } => picture.height().div_ceil(height.into()),
            Shown::Blocks(_) => picture.height().div_ceil(2),
        };
        queue!(self.out, BeginSynchronizedUpdate)?;
        self.is_stale |= rows as u16 != self.picture_rows;
        self.clear_if_stale()?;
        self.picture_rows = rows as u16;
        match self.shown {
            Shown::Nothing => {}
            Shown::Sixel { .. } => queue!(self.out, MoveTo(0, 0), Print(sixel(picture)?))?,
            Shown::Blocks(colours) => blocks::draw(picture, colours, &mut self.out)?,
        }
        queue!(self.out, EndSynchronizedUpdate)?;
        self.out.flush()
    }

    /// Shows the lines below the picture.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn show_lines(&mut self, lines: &[Line]) -> io::Result<()> {
        queue!(self.out, BeginSynchronizedUpdate)?;
        self.clear_if_stale()?;
        let (columns, rows) = terminal::size()?;
        let places = self.picture_rows..rows;
        for (row, line) in places.clone().zip(lines) {
            queue!(self.out, MoveTo(0, row))?;
            match line.look {
                Look::Plain => {}
                Look::Bold => queue!(self.out, SetAttribute(Attribute::Bold))?,
                Look::Advice => queue!(self.out, SetForegroundColor(Color::Yellow))?,
            }
            let text: String = line.text.chars().take(columns.into()).collect();
            queue!(self.out, Print(text), ResetColor, SetAttribute(Attribute::Reset))?;
            queue!(self.out, Clear(ClearType::UntilNewLine))?;
        }
        if places.len() > lines.len() {
            let after = self.picture_rows + lines.len() as u16;
            queue!(self.out, MoveTo(0, after), Clear(ClearType::FromCursorDown))?;
        }
        queue!(self.out, EndSynchronizedUpdate)?;
        self.out.flush()
    }

    /// The next key with a meaning, if one was pressed.
    ///
    /// # Errors
    /// When the terminal cannot be read.
    pub fn key(&mut self) -> io::Result<Option<Key>> {
        while event::poll(Duration::ZERO)? {
            match event::read()? {
                Event::Key(key) if key.kind != KeyEventKind::Release => {
                    let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
                    match key.code {
                        KeyCode::Char('c') if is_control => return Ok(Some(Key::Quit)),
                        KeyCode::Char('q') | KeyCode::Esc => return Ok(Some(Key::Quit)),
                        KeyCode::Char('s') => return Ok(Some(Key::Still)),
                        _ => {}
                    }
                }
                Event::Resize(..) => self.is_stale = true,
                _ => {}
            }
        }
        Ok(None)
    }

    fn clear_if_stale(&mut self) -> io::Result<()> {
        if std::mem::take(&mut self.is_stale) {
            self.picture_rows = 0;
            queue!(self.out, Clear(ClearType::All))?;
        }
        Ok(())
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // The terminal may be gone; there is nobody else to tell.
        let _ = execute!(self.out, ResetColor, LeaveAlternateScreen, Show);
        let _ = terminal::disable_raw_mode();
    }
}

fn colours() -> Colours {
    if available_color_count() > COLOURS_MIN { Colours::True } else { Colours::Palette }
}

fn cell_px() -> [u16; 2] {
    let told = terminal::window_size().ok().and_then(|size| {
        let cell = [size.width.checked_div(size.columns)?, size.height.checked_div(size.rows)?];
        (!cell.contains(&0)).then_some(cell)
    });
    told.unwrap_or(CELL_PX)
}

fn sixel(picture: &RgbImage) -> io::Result<String> {
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let opaque = picture.pixels().flat_map(|pixel| {
        let [r, g, b] = pixel.0;
        [r, g, b, u8::MAX]
    });
    // Dithering would add noise to a picture whose own noise should be visible.
    let options = EncodeOptions { diffusion: 0.0, ..EncodeOptions::default() };
    SixelImage::from_rgba(opaque.collect(), width, height)
        .encode_with(&options)
        .map_err(io::Error::other)
}

/// A grey picture at another size, in colours.
pub fn resized(picture: &image::GrayImage, [width, height]: [u32; 2]) -> RgbImage {
    let picture = if picture.dimensions() == (width, height) {
        picture.clone()
    } else {
        resize(picture, width, height, FilterType::Triangle)
    };
    image::DynamicImage::ImageLuma8(picture).into_rgb8()
}
